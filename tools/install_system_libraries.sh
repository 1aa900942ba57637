#!/bin/sh
# Install the system libraries that Drake's wheel needs but does not contain, on Debian
# and Ubuntu. Silent if nothing is missing; without root, prints the line to run.
# Determined in a bare Debian 12: importing pydrake.all needs the first; rendering with
# RenderEngineVtk without a display needs the other two (EGL alone crashes in VTK).
# drake_srg/cli/doctor.py names the same packages; tests/cli/test_doctor.py compares them.
set -eu
here=${0%/*}
[ "$here" != "$0" ] || here=.
# shellcheck source=tools/apt_install.sh
. "$here/apt_install.sh"

# shared library : package
needed='
libglib-2.0.so.0:libglib2.0-0
libEGL.so.1:libegl1
libGL.so.1:libgl1
'

known=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p)
missing=
for entry in $needed; do
    case "$known" in
        *"${entry%%:*} "*) ;;
        *) missing="$missing ${entry#*:}" ;;
    esac
done
# shellcheck disable=SC2086  # the packages are words
apt_install 'system libraries' $missing
