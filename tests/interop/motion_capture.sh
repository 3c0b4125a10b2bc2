#!/bin/sh
# Checks motion capture against programs that others wrote.
#
#     tests/interop/motion_capture.sh
#
# * NatNet 3.1 and 4.1, and VRPN: `gerono mocap send` against the client of PyPI's `motioncapture`;
# * NatNet 3.0 to 4.2: the packets of `gerono mocap send`, read by PyPI's `natnet`;
# * VRPN: `gerono mocap probe` against `vrpn_server`, built from the source package of the same.
#
# The program is $GERONO, or the release build of this tree. Everything else lives in target/mocap-venv and
# target/mocap-vrpn, made at the first run, which takes some minutes. Only loopback addresses are used, and their ports
# 1510, 1511 and 3883. Where the registry or a compiler is out of reach it is SKIPPED with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/mocap-venv
vrpn=$target/mocap-vrpn
requirements=$here/motion_capture.txt

skip() {
    echo "SKIPPED: motion capture was NOT checked against other programs: $1" >&2
    exit 3
}

cmp -s "$requirements" "$venv/requirements.txt" || rm -rf "$vrpn"
. "$here/../python_environment.sh"
python_environment "$venv" "$requirements" || skip "its packages could not be installed"

if ! [ -x "$vrpn/vrpn_server" ]; then
    command -v c++ >/dev/null || skip "there is no C++ compiler"
    rm -rf "$vrpn"
    mkdir -p "$vrpn/build"
    # Without isolation: else pip builds a cmake of its own to ask the package for its name.
    PATH="$venv/bin:$PATH" "$venv/bin/pip" download --quiet --disable-pip-version-check --no-deps --no-build-isolation \
        --no-binary motioncapture --dest "$vrpn" motioncapture==1.1 || skip "the source package could not be had"
    tar -xzf "$vrpn/motioncapture-1.1.tar.gz" -C "$vrpn"
    (
        cd "$vrpn/build"
        "$venv/bin/cmake" "$vrpn/motioncapture-1.1/deps/vrpn" -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
            -DVRPN_BUILD_JAVA=OFF -DVRPN_BUILD_PYTHON=OFF -DVRPN_BUILD_CLIENTS=OFF
        make vrpn_server
    ) >"$vrpn/build.log" 2>&1 || skip "vrpn_server could not be built, see $vrpn/build.log"
    cp "$vrpn/build/server_src/vrpn_server" "$vrpn/vrpn_server"
fi

if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
    GERONO=$target/release/gerono
fi

other=
trap '[ -z "$other" ] || kill "$other" 2>/dev/null || true' EXIT

for version in 3.1 4.1; do
    "$GERONO" mocap send --as natnet --natnet $version --noise 0 --seconds 20 &
    other=$!
    timeout 60 "$venv/bin/python" "$here/motion_capture.py" optitrack hostname=127.0.0.1 interface_ip=127.0.0.1
    kill "$other"
    wait "$other" || true
    echo "NatNet $version: the client sees the eight"
done

for version in 3.0 3.1 4.0 4.1 4.2; do
    "$GERONO" mocap send --as natnet --natnet $version --seconds 20 &
    other=$!
    timeout 60 "$venv/bin/python" "$here/natnet_reader.py" $version
    kill "$other"
    wait "$other" || true
done

"$GERONO" mocap send --as vrpn --noise 0 --seconds 40 &
other=$!
timeout 60 "$venv/bin/python" "$here/motion_capture.py" vrpn hostname=tcp://127.0.0.1:3883
kill "$other"
wait "$other" || true
echo "VRPN: the client sees the eight"

echo 'vrpn_Tracker_Spin Tracker0 2 100.0 0.0 0.0 1.0 0.5' >"$vrpn/spin.cfg"
"$vrpn/vrpn_server" -f "$vrpn/spin.cfg" 3883 >"$vrpn/server.log" 2>&1 &
other=$!
"$GERONO" mocap probe --source vrpn --object 'Tracker0#1' --seconds 5 | tee "$vrpn/probe.txt"
kill "$other"
wait "$other" || true
other=
# Its tracker turns at one place, as no camera's body does: read, and then refused as frozen.
grep -q 'frames [2-9][0-9][0-9], frozen [2-9][0-9][0-9]' "$vrpn/probe.txt"
echo "VRPN: vrpn_server is understood"
