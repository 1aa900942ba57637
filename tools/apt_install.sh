# shellcheck shell=sh
# Read in by other scripts.

# apt_install WHAT PACKAGE...: installs packages on Debian and Ubuntu; without root it
# prints the line to run and fails. Silent without packages.
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
    apt-get install -y --no-install-recommends "$@"
}
