#!/bin/sh
# Flies a sweep by every engine of docs/clusters.md, exactly by the commands of that page, and compares the merged results byte for
# byte with those of one shard.
#
#     tests/cluster/run.sh
#
# * Slurm: the array and its dependent merge; a node whose power fails, so that its tasks are requeued; a task that is killed, so
#   that the merge is cancelled and the script is run again;
# * GNU parallel and Dask: a shard that is killed, and goes on;
# * submitit: by Slurm, or as processes of this machine where there is no Slurm.
#
# The program is $GERONO, or the release build of this tree. Debian's packages are unpacked in target/cluster, not installed, and
# Python's live in a virtual environment there. Only loopback addresses are used. What cannot be had is SKIPPED, and the script
# ends with status 3 if nothing else is wrong.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
cluster=$target/cluster
debian=$cluster/debian
venv=$cluster/venv
skipped=

skip() {
    echo "SKIPPED: $1" >&2
    skipped=1
}

fail() {
    echo "$1" >&2
    exit 1
}

# `within SECONDS COMMAND…`: waits until the command succeeds; fails if it does not in time.
within() {
    deadline=$(($(date +%s) + $1))
    shift
    until "$@"; do
        if [ "$(date +%s)" -gt "$deadline" ]; then
            echo "this did not become so: $*" >&2
            return 1
        fi
        sleep 0.1
    done
}

# `unpacked NAME PACKAGE…`: Debian's packages, with what they need and this machine lacks, unpacked in `debian`.
unpacked() {
    name=$1
    shift
    [ -e "$debian/$name" ] && return
    command -v apt-get >/dev/null || return 1
    lacking=$(apt-get install --simulate --no-install-recommends "$@" 2>/dev/null | sed -n 's/^Inst \([^ ]*\).*/\1/p')
    rm -rf "$cluster/packages"
    mkdir -p "$cluster/packages" "$debian"
    # shellcheck disable=SC2086 # words are wanted
    (cd "$cluster/packages" && apt-get download --quiet=2 -o APT::Sandbox::User="$(id -un)" $(printf '%s\n' $lacking "$@" | sort -u)) ||
        return 1
    for package in "$cluster/packages"/*.deb; do
        dpkg -x "$package" "$debian"
    done
    touch "$debian/$name"
}

# The commands of an engine, as the page has them.
block() {
    sed -n "/^<!-- $1 -->/,/^<!-- end of $1 -->/p" "$root/docs/clusters.md" | sed -n '/^```./,/^```$/p' | sed '/^```/d'
}

# A folder for an engine, in which its commands can be run as they stand.
folder() {
    mkdir "$work/$1"
    cp "$here/sweep.toml" "$root/scenarios/fig1.toml" "$work/$1"
    cd "$work/$1"
    block "$1" >"$work/$1/commands"
    [ -s commands ] || fail "docs/clusters.md has no commands of $1"
}

# The results of an engine are those of one shard.
same() {
    for file in results.parquet sweep.json sweep.md index.html; do
        cmp "$work/whole/$file" "$work/$1/results/$file" || fail "$1: $file differs from that of one shard"
    done
}

# The shard 1 of 4 of this folder is on its way: some of its rows are on the disk, not all.
on_its_way() {
    [ "$(stat --format=%s results/shard-00001-of-00004.rows.partial 2>/dev/null || echo 0)" -gt 20000 ]
}

# Kills the process that flies shard 1 of 4 in this folder.
kill_shard() {
    for process in /proc/[0-9]*; do
        if [ "$(readlink "$process/cwd" 2>/dev/null)" = "$PWD" ] && tr '\0' ' ' <"$process/cmdline" | grep -q '^gerono .*--shard 1/4'; then
            kill -KILL "${process#/proc/}"
            return
        fi
    done
    fail "no process flies shard 1/4"
}

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi
mkdir -p "$cluster"
work=$(mktemp -d "$cluster/work.XXXXXX")
. "$here/slurm.sh"
engine=
# Slurm first, then an engine that is left, then their files; the logs are shown if something is wrong.
clean_up() {
    status=$?
    slurm_stop
    [ -z "$engine" ] || kill "$engine" 2>/dev/null || true
    if [ $status != 0 ] && [ $status != 3 ]; then
        tail -n 20 "$work"/daemons/*.log "$work"/*/slurm-*.out "$work"/*/engine.log 2>/dev/null || true
    fi
    cd "$root"
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 1' INT TERM
export PATH="$(cd "$(dirname "$GERONO")" && pwd):$PATH"
# What an engine keeps of its user goes there.
export HOME="$work"

mkdir "$work/whole"
cp "$here/sweep.toml" "$root/scenarios/fig1.toml" "$work/whole"
gerono sweep run "$work/whole/sweep.toml" --out "$work/whole" >"$work/whole/report"

# The array job, and the merge of it, from what the script says: "array 4, merge 5".
submitted() {
    sh -eu commands >submitted
    array=$(sed -n 's/^array \([0-9]*\), merge [0-9]*$/\1/p' submitted)
    merge=$(sed -n 's/^array [0-9]*, merge \([0-9]*\)$/\1/p' submitted)
    [ -n "$array" ] && [ -n "$merge" ] || fail "the script says: $(cat submitted)"
}

slurm() {
    folder slurm
    submitted
    within 60 on_its_way
    slurm_power_failure
    within 120 slurm_is "$merge" COMPLETED
    [ "$(slurm_says "${array}_1" Restarts)" = 1 ] || fail "Slurm did not requeue task 1"
    flown=$(sed -n 's/^\([0-9]*\) flights in .*/\1/p' "slurm-${array}_1.out")
    [ "$flown" -gt 0 ] && [ "$flown" -lt 120 ] || fail "the requeued task flew $flown of its 120 flights"
    same slurm
    echo "Slurm: after a power failure the requeued task flew the last $flown of its 120 flights; the bytes are those of one shard"

    rm -r results
    submitted
    within 60 on_its_way
    kill_shard
    within 20 slurm_is "${array}_1" FAILED
    within 60 slurm_is "$merge" CANCELLED
    within 60 slurm_is_empty
    submitted
    within 120 slurm_is "$merge" COMPLETED
    same slurm
    echo "Slurm: a task that was killed cancels the merge; the script run again ends with the bytes of one shard"
}

gnu_parallel() {
    folder parallel
    timeout 300 sh -eu commands >engine.log 2>&1 &
    engine=$!
    within 60 on_its_way
    kill_shard
    if wait "$engine"; then
        fail "GNU parallel does not tell that a shard was killed"
    fi
    timeout 300 sh -eu commands >>engine.log 2>&1
    [ "$(grep -c 'gerono sweep run' jobs.log)" = 5 ] || fail "GNU parallel did not run the killed shard alone again: $(cat jobs.log)"
    same parallel
    echo "GNU parallel: the shard that was killed was repeated, alone; the bytes are those of one shard"
}

submitit() {
    folder submitit
    timeout 300 "$venv/bin/python" commands >engine.log 2>&1
    same submitit
    by=${slurmctld:+Slurm}
    echo "submitit, by ${by:-processes of this machine}: the bytes are those of one shard"
}

dask() {
    folder dask
    timeout 300 "$venv/bin/python" commands >engine.log 2>&1 &
    engine=$!
    within 60 on_its_way
    kill_shard
    wait "$engine"
    same dask
    echo "Dask: the shard that was killed was repeated; the bytes are those of one shard"
}

if unpacked slurm slurmctld slurmd slurm-client slurm-wlm-basic-plugins; then
    slurm_start
    slurm
else
    skip "Slurm: Debian's packages cannot be had (apt-get update)"
fi

. "$here/../python_environment.sh"
if python_environment "$venv" "$here/requirements.txt"; then
    submitit
    slurm_stop
    dask
else
    skip "submitit and Dask: their packages cannot be installed"
fi

if unpacked parallel parallel; then
    export PATH="$debian/usr/bin:$PATH"
    gnu_parallel
else
    skip "GNU parallel: Debian's package cannot be had (apt-get update)"
fi
[ -z "$skipped" ] || exit 3
