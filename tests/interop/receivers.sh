#!/bin/sh
# Checks the decoders of satellite receivers and autopilots on packets that other programs have written: UBX by pyubx2, MAVLink by
# pymavlink; `gerono gnss probe` on a pseudo-terminal and a socket to which they send; and what `gerono world` sends, read by both.
#
#     tests/interop/receivers.sh [COUNT]
#
# COUNT random packets of each message, 2000 unless stated. The program is $GERONO, or the release build of this tree. The
# libraries live in target/receivers-venv, made at the first run; without a network it is SKIPPED with status 3. The packets of
# the crate's own test were made by `receivers.py 6 7`.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/receivers-venv

. "$here/../python_environment.sh"
if ! python_environment "$venv" "$here/receivers_requirements.txt"; then
    echo "SKIPPED: pyubx2 and pymavlink cannot be installed" >&2
    exit 3
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$venv/bin/python" "$here/receivers.py" "${1:-2000}" "$(date +%s)" >"$work/packets.txt"
GERONO_RECEIVER_PACKETS=$work/packets.txt cargo test --quiet --manifest-path "$root/Cargo.toml" --package navigation_receivers \
    --test it -- published_libraries --nocapture

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi
"$venv/bin/python" "$here/receiver_lines.py" "$GERONO"
"$venv/bin/python" "$here/receivers_world.py" "$GERONO" "$root/scenarios/laboratory_outdoor.toml"
