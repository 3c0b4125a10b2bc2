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

. "$here/../python_environment.sh"
python_environment "$venv" "$here/delay_requirements.txt"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$venv/bin/python" "$here/delay.py" "$GERONO" "$root/scenarios/fig3_6.toml" "${1:-8}" "$work"
