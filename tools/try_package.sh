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

rm -rf dist
"$bin/hatchling" build -d dist >/dev/null
tar -xzf dist/*.tar.gz -C "$trial"
(cd "$trial"/drake_srg-* && "$bin/hatchling" build -t wheel -d "$trial/again" >/dev/null)
cmp dist/*.whl "$trial"/again/*.whl

"$bin/python" -m venv "$trial/venv"
"$trial/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    --constraint requirements.lock dist/*.whl
cd "$trial"
unset PYTHONPATH
venv/bin/drake-srg --version
venv/bin/drake-srg new trial --quiet
venv/bin/drake-srg export kitchen_tendon --mjcf models --quiet
venv/bin/drake-srg demo --quiet --out demo
test -s demo/replay.html
ls "$project"/dist/*
