#!/bin/sh
# Installs the Python package as a user would, and tries it: types, tests, the notebook.
#
#     tests/python/run.sh
#
# The environment lives in target/python-venv.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
venv=${CARGO_TARGET_DIR:-$root/target}/python-venv

# The environment is complete only if it says which requirements it was made of.
if ! cmp -s "$here/requirements.txt" "$venv/requirements.txt"; then
    rm -rf "$venv"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --requirement "$here/requirements.txt"
    "$venv/bin/pip" check --disable-pip-version-check
    cp "$here/requirements.txt" "$venv/requirements.txt"
fi

"$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --force-reinstall "$root"
"$venv/bin/pip" check --disable-pip-version-check
cd "$root/python/tests"
"$venv/bin/mypy" --strict --package gerono
"$venv/bin/python" -m pytest --quiet -p no:cacheprovider .
cd "$root/examples/notebook"
"$venv/bin/python" "$here/notebook.py" comparison.ipynb
