#!/bin/sh
# Compares inertial navigation with the optimum that gtsam finds for the same samples of simulated flights outdoors.
#
#     tests/interop/batch_optimum.sh [FLIGHTS]
#
# FLIGHTS with the modelled errors of the sensors and as many with all, 5 unless stated; prints a table. The program is $GERONO, or
# the release build of this tree. gtsam lives in target/batch-optimum-venv, made at the first run; without a network it is
# SKIPPED with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/batch-optimum-venv

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi

. "$here/../python_environment.sh"
if ! python_environment "$venv" "$here/batch_optimum_requirements.txt"; then
    echo "SKIPPED: gtsam cannot be installed" >&2
    exit 3
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$venv/bin/python" "$here/batch_optimum.py" "$GERONO" "$root/scenarios/outdoor_rtk.toml" "${1:-5}" "$work"
