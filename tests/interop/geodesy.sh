#!/bin/sh
# Compares the frame of a flight outdoors with PROJ and pymap3d: random positions up to 100 km from random datums, everywhere on the
# earth, and back.
#
#     tests/interop/geodesy.sh
#
# Both live in target/geodesy-venv, made at the first run; without a network it is SKIPPED with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/geodesy-venv

cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package shared_types --example places

. "$here/../python_environment.sh"
if ! python_environment "$venv" "$here/geodesy_requirements.txt"; then
    echo "SKIPPED: pyproj and pymap3d cannot be installed" >&2
    exit 3
fi
"$venv/bin/python" "$here/geodesy.py" "$target/release/examples/places"
