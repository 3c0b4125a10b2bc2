#!/bin/sh
# Fuzzes the decoders, guided by coverage.
#
#     services/motion_capture/fuzz/run.sh [SECONDS]
#
# Each of the three decoders for SECONDS (1200 unless stated), from the committed corpus. Needs nothing but the stable
# toolchain and a C++ compiler. What it finds is named at the end; commit it to ../corpus, whose files a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
seconds=${1:-1200}
target=${CARGO_TARGET_DIR:-$here/../../../target}/fuzz
host=$(rustc -vV | sed -n 's/^host: //p')

# With a target stated build scripts are left alone.
RUSTFLAGS="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
-Cllvm-args=-sanitizer-coverage-trace-compares" \
    cargo build --release --quiet --manifest-path "$here/Cargo.toml" --target "$host" --target-dir "$target"

for decoder in vicon_udp vrpn natnet; do
    found=$target/found/$decoder
    mkdir -p "$found" "$target/crashes"
    echo "== $decoder, $seconds s"
    "$target/$host/release/$decoder" -max_total_time="$seconds" -max_len=4096 -rss_limit_mb=512 -timeout=5 \
        -print_final_stats=1 -verbosity=0 -artifact_prefix="$target/crashes/$decoder-" "$found" "$here/../corpus"
done
echo "nothing was found"
