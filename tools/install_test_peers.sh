#!/bin/sh
# Installs what the tests of the bridges talk to, on Debian and Ubuntu: ROS 1, and
# another implementation of DDS. Silent when nothing is missing; without root it prints
# the line to run. The package itself needs none of these.
set -eu
here=${0%/*}
[ "$here" != "$0" ] || here=.
# shellcheck source=tools/apt_install.sh
. "$here/apt_install.sh"

needed='ros-core python3-rospy python3-std-msgs python3-sensor-msgs libfastrtps-dev g++'

missing=
for package in $needed; do
    case "$(dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null)" in
        'install ok installed') ;;
        *) missing="$missing $package" ;;
    esac
done
# shellcheck disable=SC2086  # the packages are words
apt_install 'packages for the tests of the bridges' $missing
