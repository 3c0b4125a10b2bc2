#!/bin/sh
# Checks a run log with two independent readers of MCAP and CDR, and what is recovered of it when it is damaged with a third;
# and the copy for viewers of a short flight with Foxglove's own definitions and with Rerun. Then the table of a sweep is read by
# pandas, polars and DuckDB, and so are those of $GERONO_SWEEPS random sweeps, 8 unless stated.
#
#     tests/interop/run.sh RUN.mcap [EVERY]
#
# Compares the samples of every EVERY-th tick (1 unless stated) with `gerono export`. The program is $GERONO, or
# the release build of this tree. The readers live in target/interop-venv, made at the first run.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/interop-venv

if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
    exit 2
fi
log=$1
every=${2:-1}

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi

. "$here/../python_environment.sh"
python_environment "$venv" "$here/requirements.txt"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Compares a log with what `gerono export` says of it.
check() {
    "$GERONO" export "$1" --every "$every" --output "$work/export.jsonl"
    "$venv/bin/python" "$here/check.py" "$1" "$work/export.jsonl" "$every"
}

check "$log"
"$venv/bin/python" "$here/recovery.py" "$log" "$GERONO" "$venv/bin/pymcap-cli" "$work"
check "$work/damaged.recovered.mcap"

# What is added for viewers is looked at over a short flight.
"$GERONO" run "$root/scenarios/fig1.toml" --host inprocess --set duration=5.0 --set 'vehicle.change=[]' --quiet --out "$work/short"
"$GERONO" export "$work/short" --view --out "$work/view.mcap"
"$venv/bin/python" "$here/view.py" "$work/short/run.mcap" "$work/view.mcap" "$venv/bin/rerun" "$work"

mkdir "$work/sweep"
"$venv/bin/python" "$here/sweep.py" "$GERONO" "$here/sweep.toml" "$work/sweep"
"$venv/bin/python" "$here/random_sweeps.py" "$GERONO" "$root/scenarios/fig1.toml" "${GERONO_SWEEPS:-8}" 1 "$work/sweeps"
