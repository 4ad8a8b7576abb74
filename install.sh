#!/bin/sh
# Makes or reuses the virtual environment .venv and installs the pinned packages and extremum in it.
# Needs only Python >= 3.11 and pip >= 22.3; Debian's own will do (venv without ensurepip).
set -eu
cd "$(dirname "$0")"
python=${PYTHON:-python3}
[ -x .venv/bin/python ] || "$python" -m venv --without-pip .venv
"$python" -m pip --disable-pip-version-check --python .venv/bin/python install --quiet --require-hashes -r requirements.txt
"$python" -m pip --disable-pip-version-check --python .venv/bin/python install --quiet --no-deps --no-build-isolation -e .
