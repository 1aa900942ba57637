#!/bin/sh
# Installs packages on Debian and Ubuntu; without root it prints the line to run and
# fails. Usage: apt_install.sh WHAT PACKAGE...
set -eu

what=$1
shift
[ $# -gt 0 ] || exit 0

if [ "$(id -u)" -ne 0 ]; then
    echo "Missing $what. Run:" >&2
    echo "sudo apt-get update && sudo apt-get install -y --no-install-recommends $*" >&2
    exit 1
fi
apt-get update
apt-get install -y --no-install-recommends "$@"
