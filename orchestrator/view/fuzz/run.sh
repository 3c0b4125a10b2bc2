#!/bin/sh
# Fuzzes the reader of requests and the rules of who may see what, guided by coverage.
#
#     orchestrator/view/fuzz/run.sh [SECONDS]
#
# For SECONDS (3600 unless stated), from the committed corpus. Needs nothing but the stable toolchain and a C++ compiler.
# What it finds is named at the end; commit it to corpus, whose files a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$here/../../..
seconds=${1:-3600}
. "$root/tests/fuzz.sh"

fuzz request "$seconds" "$here/corpus" -max_len=9000 -rss_limit_mb=512 -timeout=5 -dict="$here/words"
echo "nothing was found"
