# shellcheck shell=sh
# Sourced by other scripts.

# apt_install WHAT PACKAGE...: install packages on Debian and Ubuntu. Without root, print
# the line to run and fail. Without packages, do nothing.
apt_install() {
    what=$1
    shift
    [ $# -gt 0 ] || return 0
    if [ "$(id -u)" -ne 0 ]; then
        echo "Missing $what. Run:" >&2
        echo "sudo apt-get update && sudo apt-get install -y --no-install-recommends $*" >&2
        return 1
    fi
    apt-get update
    # Another program may be installing, too: wait for it.
    apt-get -o DPkg::Lock::Timeout=600 install -y --no-install-recommends "$@"
}
