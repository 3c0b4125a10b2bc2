#!/bin/sh
# Checks the noise of a simulated inertial measurement unit with allantools: the Allan deviation of an hour at rest is that of
# the stated white noise and bias walk.
#
#     tests/interop/allan.sh
#
# allantools lives in target/allan-venv, made at the first run; without a network it is SKIPPED with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/allan-venv

cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package sensor_models --example imu_at_rest

. "$here/../python_environment.sh"
if ! python_environment "$venv" "$here/allan_requirements.txt"; then
    echo "SKIPPED: allantools cannot be installed" >&2
    exit 3
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$target/release/examples/imu_at_rest" 3600 100 1 >"$work/samples" 2>"$work/stated"
"$venv/bin/python" "$here/allan.py" "$work/samples" 100 "$work/stated"
