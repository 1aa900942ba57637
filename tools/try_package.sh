#!/bin/sh
# Build dist/ (sdist and wheel) and try the wheel, as `make package` does.
#
# The wheel that the sdist makes must be that of the checkout, byte for byte. It is
# installed with the pinned packages into a new virtual environment, and runs the demo
# from another folder.
set -eu
cd "${0%/*}/.."
project=$PWD
bin=${BIN:-$project/.venv/bin}
trial=$(mktemp -d)
trap 'rm -rf "$trial"' EXIT INT TERM

build() { # ARGUMENTS of `uv build`
    "$bin/uv" build --quiet --no-build-isolation --python "$bin/python" "$@"
}
rm -rf dist
build --out-dir dist # the wheel is built from the sdist
build --out-dir "$trial/direct" --wheel
cmp dist/*.whl "$trial"/direct/*.whl

"$bin/uv" venv --quiet --python "$bin/python" "$trial/venv"
VIRTUAL_ENV=$trial/venv "$bin/uv" pip install --quiet \
    --constraint requirements.lock dist/*.whl
cd "$trial"
unset PYTHONPATH
venv/bin/drake-srg --version
venv/bin/drake-srg new trial
venv/bin/drake-srg export kitchen_tendon --mjcf models --quiet
venv/bin/drake-srg demo --quiet --out demo
test -s demo/replay.html
ls "$project"/dist/*
