# Builds the fuzzers of a package with what guides them by coverage; for its run.sh, which sources this.
#
# Takes `here`, the folder of the package, and `root`, that of the repository; gives `fuzz`, which runs one.
# Needs nothing but the stable toolchain and a C++ compiler.

fuzzing=${CARGO_TARGET_DIR:-$root/target}/fuzz
host=$(rustc -vV | sed -n 's/^host: //p')
fuzzers=$fuzzing/$host/release

# With a target stated build scripts are left alone.
RUSTFLAGS="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
-Cllvm-args=-sanitizer-coverage-trace-compares" \
    cargo build --release --quiet --manifest-path "$here/Cargo.toml" --target "$host" --target-dir "$fuzzing"

# Runs a fuzzer, from its corpus: `fuzz NAME SECONDS CORPUS LIMIT…`.
fuzz() {
    name=$1
    duration=$2
    corpus=$3
    shift 3
    mkdir -p "$fuzzing/found/$name" "$fuzzing/crashes"
    "$fuzzers/$name" -max_total_time="$duration" "$@" -print_final_stats=1 -verbosity=0 \
        -artifact_prefix="$fuzzing/crashes/$name-" "$fuzzing/found/$name" "$corpus"
}
