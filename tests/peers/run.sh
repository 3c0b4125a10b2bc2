#!/bin/sh
# Measures the flights of sweeps beside two other simulators, in turns: crazyflow (JAX), and MuJoCo in C.
#
#     tests/peers/run.sh [OPTION OF gerono-bench sweep]…
#
# The program is $GERONO_BENCH, or the release build of this tree. The simulators live in target/peers, made at the first run.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/peers

if [ -z "${GERONO_BENCH:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono-bench
    GERONO_BENCH=$target/release/gerono-bench
fi

# The environment is complete only if it says which requirements it was made of.
if ! cmp -s "$here/requirements.txt" "$venv/requirements.txt"; then
    rm -rf "$venv"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --requirement "$here/requirements.txt"
    cp "$here/requirements.txt" "$venv/requirements.txt"
fi

# They write their warnings into a file where they run.
exec "$GERONO_BENCH" sweep \
    --beside "crazyflow=cd '$venv' && bin/python '$here/crazyflow_rate.py'" \
    --beside "MuJoCo=cd '$venv' && bin/python '$here/mujoco_rate.py'" "$@"
