#!/bin/sh
# Fuzzes the decoders of all motion-capture systems, guided by coverage.
#
#     services/motion_capture/fuzz/run.sh [SECONDS]
#
# For SECONDS (3600 unless stated), from the committed corpus. Needs nothing but the stable toolchain and a C++ compiler.
# What it finds is named at the end; commit it to ../corpus, whose files a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$here/../../..
seconds=${1:-3600}
. "$root/tests/fuzz.sh"

fuzz decoders "$seconds" "$here/../corpus" -max_len=4096 -rss_limit_mb=512 -timeout=5
echo "nothing was found"
