#!/bin/sh
# Imports PX4's recorded flight `iris_gps`, which the crate `ekf2` has, and compares the estimator with what EKF2 made of it; then
# the same flight as a ULog file, read by PX4's own reader.
#
#     tests/interop/recorded_flights.sh
#
# Prints a table. The program is $GERONO, or the release build of this tree. pyulog lives in target/ulog-venv, made at the first
# run; without a network it is SKIPPED with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/ulog-venv
ekf2=$root/services/inertial_navigation/ekf2

. "$here/../python_environment.sh"
if ! python_environment "$venv" "$here/ulog_requirements.txt"; then
    echo "SKIPPED: pyulog cannot be installed" >&2
    exit 3
fi
metadata=$(cargo metadata --format-version 1 --manifest-path "$ekf2/Cargo.toml") || {
    echo "SKIPPED: the crate ekf2 cannot be fetched" >&2
    exit 3
}
data=$(printf '%s' "$metadata" | python3 -c 'import json, os, sys
print(*(os.path.dirname(p["manifest_path"]) for p in json.load(sys.stdin)["packages"] if p["name"] == "ekf2"))')/tests/data

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$venv/bin/python" "$here/ulog.py" "$data/iris_gps_replay.csv" "$data/iris_gps_reference.csv" "$work" >&2
"$venv/bin/python" "$here/recorded_flights.py" "$GERONO" "$ekf2/iris_gps.toml" "$data" "$work"
