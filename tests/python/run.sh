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

. "$here/../python_environment.sh"
python_environment "$venv" "$here/requirements.txt"

"$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --force-reinstall "$root"
"$venv/bin/pip" check --disable-pip-version-check
cd "$root/python/tests"
"$venv/bin/mypy" --strict --package gerono
"$venv/bin/python" -m pytest --quiet -p no:cacheprovider .
cd "$root/examples/notebook"
"$venv/bin/python" "$here/notebook.py" comparison.ipynb
