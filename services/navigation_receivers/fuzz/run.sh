#!/bin/sh
# Fuzzes the decoders of satellite receivers and autopilots, guided by coverage.
#
#     services/navigation_receivers/fuzz/run.sh [SECONDS]
#
# Runs for SECONDS (default 3600) from the committed corpus. Needs the stable toolchain and a C++ compiler.
# Names a failing input at the end; commit it to ../corpus, which a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$here/../../..
seconds=${1:-3600}
. "$root/tests/fuzz.sh"

fuzz stream "$seconds" "$here/../corpus" -max_len=2048 -rss_limit_mb=512 -timeout=5
echo "no failing input"
