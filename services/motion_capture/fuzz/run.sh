#!/bin/sh
# Fuzzes the decoders of all motion-capture systems, guided by coverage.
#
#     services/motion_capture/fuzz/run.sh [SECONDS]
#
# Runs for SECONDS (default 3600) from the committed corpus. Needs the stable toolchain and a C++ compiler.
# Names a failing input at the end; commit it to ../corpus, which a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$here/../../..
seconds=${1:-3600}
. "$root/tests/fuzz.sh"

fuzz decoders "$seconds" "$here/../corpus" -max_len=4096 -rss_limit_mb=512 -timeout=5
echo "no failing input"
