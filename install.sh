#!/bin/sh
# Makes or reuses the virtual environment .venv and installs the pinned packages and extremum in it.
# Needs only Python >= 3.11 and pip >= 22.3; Debian's own will do (a venv without ensurepip).
# PYTHON=python3.12 sh install.sh takes another interpreter.
set -eu
cd "$(dirname "$0")"
python=${PYTHON:-python3}
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "extremum needs Python >= 3.11, $python is $("$python" --version 2>&1); set PYTHON" >&2
    exit 1
fi
[ -x .venv/bin/python ] || "$python" -m venv --without-pip .venv
pip() { "$python" -m pip --disable-pip-version-check --python .venv/bin/python install --quiet "$@"; }
pip --require-hashes -r requirements.txt
pip --no-deps --no-build-isolation -e .
