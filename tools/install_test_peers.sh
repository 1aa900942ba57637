#!/bin/sh
# Install the programs that the tests run against, on Debian and Ubuntu: ROS 1, another
# implementation of DDS, a browser. Silent if nothing is missing; without root, prints the
# line to run. The package itself does not need them. (Ubuntu ships Chromium as a snap
# only; there, any other `chromium` on the PATH will do.)
set -eu
here=${0%/*}
[ "$here" != "$0" ] || here=.
# shellcheck source=tools/apt_install.sh
. "$here/apt_install.sh"

needed='ros-core python3-rospy python3-std-msgs python3-sensor-msgs libfastrtps-dev g++'
command -v chromium >/dev/null || needed="$needed chromium"

missing=
for package in $needed; do
    case "$(dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null)" in
        'install ok installed') ;;
        *) missing="$missing $package" ;;
    esac
done
# shellcheck disable=SC2086  # the packages are words
apt_install 'packages for the tests' $missing
