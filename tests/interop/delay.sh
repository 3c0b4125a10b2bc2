#!/bin/sh
# Compares the delay and the lag that `gerono identify` finds with fits of SciPy, over simulated flights with random delays.
#
#     tests/interop/delay.sh [FLIGHTS]
#
# FLIGHTS is 8 unless stated. The program is $GERONO, or the release build of this tree. SciPy lives in target/delay-venv, made at
# the first run; without a network it is SKIPPED with status 3.
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
if ! python_environment "$venv" "$here/delay_requirements.txt"; then
    echo "SKIPPED: SciPy cannot be installed" >&2
    exit 3
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$venv/bin/python" "$here/delay.py" "$GERONO" "$root/scenarios/fig3_6.toml" "${1:-8}" "$work"
