#!/bin/sh
# Fuzzes the log reader and the recovery of logs, guided by coverage.
#
#     orchestrator/fuzz/run.sh [SECONDS]
#
# For SECONDS (3600 unless stated), from the committed corpus. Needs nothing but the stable toolchain and a C++ compiler.
# What it finds is named at the end; commit it to corpus, whose files a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$here/../..
seconds=${1:-3600}
. "$root/tests/fuzz.sh"

# Every input is a file for a moment: in memory, where there is such a place.
TMPDIR=$(mktemp -d -p "$([ -d /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")")
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

fuzz log "$seconds" "$here/corpus" -max_len=4096 -rss_limit_mb=1024 -timeout=10
echo "nothing was found"
