#!/bin/sh
# Fuzzes the decoders, guided by coverage.
#
#     services/motion_capture/fuzz/run.sh [SECONDS]
#
# Each of the three decoders for SECONDS (1200 unless stated), from the committed corpus. Needs nothing but the stable
# toolchain and a C++ compiler. What it finds is named at the end; commit it to ../corpus, whose files a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$here/../../..
seconds=${1:-1200}
. "$root/tests/fuzz.sh"

for decoder in vicon_udp vrpn natnet; do
    echo "== $decoder, $seconds s"
    fuzz $decoder "$seconds" "$here/../corpus" -max_len=4096 -rss_limit_mb=512 -timeout=5
done
echo "nothing was found"
