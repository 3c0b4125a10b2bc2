#!/bin/sh
# Compares the filter with PX4's EKF2, the crate `ekf2`, on the same samples of simulated flights; on PX4's recorded flight
# tests/interop/recorded_flights.sh does.
#
#     services/inertial_navigation/ekf2/run.sh [SEEDS]
#
# SEEDS flights a row, 20 unless stated; prints a table, and fails if the filter errs more than EKF2. It needs a C++ compiler, and libclang,
# which it takes from PyPI where LIBCLANG_PATH names none; where one of them cannot be had, it is SKIPPED with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
seeds=${1:-20}

skip() {
    echo "SKIPPED: $1" >&2
    exit 3
}

command -v c++ >/dev/null || skip "there is no C++ compiler"
if [ -z "${LIBCLANG_PATH:-}" ]; then
    venv=$target/libclang-venv
    if ! [ -e "$venv/complete" ]; then
        rm -rf "$venv"
        python3 -m venv "$venv" &&
            "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps libclang==18.1.1 &&
            touch "$venv/complete" || skip "libclang cannot be installed"
    fi
    LIBCLANG_PATH=$(dirname "$(find "$venv" -name libclang.so)")
    # That package has no headers of the compiler.
    BINDGEN_EXTRA_CLANG_ARGS="-I$(c++ -print-file-name=include)"
    export LIBCLANG_PATH BINDGEN_EXTRA_CLANG_ARGS
fi

cargo build --quiet --release --manifest-path "$here/Cargo.toml" --target-dir "$target/ekf2"
"$target/ekf2/release/inertial_navigation_ekf2" "$seeds"
