#!/bin/sh
# Fuzzes the decoders of all radio links, guided by coverage.
#
#     services/radio_link/fuzz/run.sh [SECONDS]
#
# For SECONDS (3600 unless stated), from the committed corpus. Needs nothing but the stable toolchain and a C++ compiler.
# What it finds is named at the end; commit it to ../tests/corpus, whose files a test replays.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
seconds=${1:-3600}
target=${CARGO_TARGET_DIR:-$here/../../../target}/fuzz
host=$(rustc -vV | sed -n 's/^host: //p')

# With a target stated build scripts are left alone.
RUSTFLAGS="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
-Cllvm-args=-sanitizer-coverage-trace-compares" \
    cargo build --release --quiet --manifest-path "$here/Cargo.toml" --target "$host" --target-dir "$target"

found=$target/found/receiver
mkdir -p "$found" "$target/crashes"
"$target/$host/release/receiver" -max_total_time="$seconds" -max_len=2048 -rss_limit_mb=512 -timeout=5 \
    -print_final_stats=1 -verbosity=0 -artifact_prefix="$target/crashes/receiver-" "$found" "$here/../tests/corpus"
echo "nothing was found"
