#!/bin/sh
# Compares the delay and the lag that `gerono identify` finds with fits of SciPy, over simulated flights with random delays.
#
#     tests/interop/delay.sh [FLIGHTS]
#
# FLIGHTS is 8 unless stated. The program is $GERONO, or the release build of this tree. SciPy lives in target/delay-venv, made at
# the first run.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/delay-venv

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi

# The environment is complete only if it says which requirements it was made of.
if ! cmp -s "$here/delay_requirements.txt" "$venv/requirements.txt"; then
    rm -rf "$venv"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --requirement "$here/delay_requirements.txt"
    "$venv/bin/pip" check --disable-pip-version-check
    cp "$here/delay_requirements.txt" "$venv/requirements.txt"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$venv/bin/python" "$here/delay.py" "$GERONO" "$root/scenarios/fig3_6.toml" "${1:-8}" "$work"
