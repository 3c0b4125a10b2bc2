#!/bin/sh
# Flies the tilted eight with Betaflight in the loop: its rate loop and its mixer turn the motors of the simulated vehicle.
#
#     tests/interop/sitl.sh [SECONDS]
#
# Three programs, and only sockets between them: `gerono run scenarios/sitl_betaflight.toml` sends MSP_SET_RAW_RC to
# Betaflight, Betaflight sends its motors to `gerono world` and gets its gyro from there, and the world's cameras send poses by
# VRPN to the flight. After SECONDS (40 unless stated) from arming the vehicle lands. The script fails unless the true distance
# from the path was below 1 cm, root mean square.
#
# The firmware is that of tests/interop/radio.sh; BETAFLIGHT_SITL names a program that has been built elsewhere, GERONO one
# that is not to be built here. If the firmware cannot be had the script ends with status 3. The ports 3883, 5761, 9002 and
# 9003 of the loopback must be free.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
scenario=$root/scenarios/sitl_betaflight.toml
seconds=${1:-40}

. "$here/betaflight.sh"
if ! betaflight_build; then
    echo "SKIPPED: Betaflight cannot be built (see $firmware/make.log)" >&2
    exit 3
fi
if [ -z "${GERONO:-}" ]; then
    cargo build --quiet --manifest-path "$root/Cargo.toml"
    GERONO=${CARGO_TARGET_DIR:-$root/target}/debug/gerono
fi

work=$(mktemp -d)
controller=
world=
flight=
finish() {
    for program in $flight $world $controller; do
        kill -INT "$program" 2>/dev/null || true
    done
    for program in $flight $world; do
        wait "$program" || true
    done
    [ -z "$controller" ] || kill "$controller" 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT
mkdir "$work/controller"
mkdir -m 700 "$work/run"
export XDG_RUNTIME_DIR="$work/run" GERONO_RUNS="$work/run"
cd "$work/controller"

# Rates that are linear in the stick, a switch that arms, nothing that makes the commands smoother or later than they are, and
# more yaw than a lighter vehicle needs. It ends when it has saved them.
"$sitl" >first.log 2>&1 &
controller=$!
python3 "$here/sitl_settings.py" 127.0.0.1 5761 'set serial_update_rate_hz = 2000' 'aux 0 0 0 1700 2100 0 0' \
    'set rates_type = ACTUAL' 'set rc_smoothing = OFF' 'set anti_gravity_gain = 0' 'set tpa_rate = 0' \
    'set roll_rc_rate = 109' 'set roll_srate = 109' 'set roll_expo = 0' \
    'set pitch_rc_rate = 109' 'set pitch_srate = 109' 'set pitch_expo = 0' \
    'set yaw_rc_rate = 46' 'set yaw_srate = 46' 'set yaw_expo = 0' \
    'set simplified_pids_mode = OFF' 'set f_roll = 0' 'set f_pitch = 0' 'set f_yaw = 0' 'set p_yaw = 150' \
    'set runaway_takeoff_prevention = OFF' 'set small_angle = 180' 'feature -GPS' save
wait "$controller"

# `simulate OUT`: a world, and then Betaflight, which calibrates its gyro at the start.
simulate() {
    "$GERONO" world "$scenario" --betaflight --out "$work/$1" &
    world=$!
    (cd controller && exec "$sitl" >second.log 2>&1) &
    controller=$!
    python3 "$here/sitl_settings.py" 127.0.0.1 5761
    python3 "$here/sitl_ready.py" 127.0.0.1 5761
}

end_the_world() {
    kill -INT "$world"
    wait "$world"
    world=
}

cd "$work"
simulate world
"$GERONO" run "$scenario" --host realtime --out "$work/flight" >flight.txt 2>&1 &
flight=$!
patience=60
until "$GERONO" arm >arm.txt 2>&1; do
    patience=$((patience - 1))
    if [ "$patience" = 0 ]; then
        cat arm.txt flight.txt >&2
        exit 1
    fi
    sleep 1
done
sleep "$seconds"
"$GERONO" stop
wait "$flight" || { cat flight.txt; exit 1; }
flight=
cat flight.txt
end_the_world
"$GERONO" truth flight --world world
"$GERONO" truth flight --world world --json | python3 -c '
import json, sys
error = json.load(sys.stdin)["parts"][-1]["rmse"]
assert error < 0.01, f"{error} m from the path"
'

# Its mixer answers each stick with the right motors, and a reversed stick with the wrong ones. It is a simulation of its own: its
# propellers tip the vehicle.
kill "$controller"
wait "$controller" || true
simulate motors
"$GERONO" rc motors "$scenario" --propellers-off
status=0
"$GERONO" rc motors "$scenario" --propellers-off --set "rc_output.transmitter.reversed='A'" >reversed.txt || status=$?
cat reversed.txt
[ "$status" = 6 ] && grep -q 'roll rate .*WRONG: the motors turn the vehicle the other way' reversed.txt
python3 "$here/sitl_rest.py" 127.0.0.1 5761
# Its motors rest after the test, wherever that is interrupted.
for after in 0.5 1.5 2.5 3.5; do
    status=0
    timeout --signal=INT "$after" "$GERONO" rc motors "$scenario" --propellers-off >interrupted.txt 2>&1 || status=$?
    cat interrupted.txt
    [ "$status" = 124 ]
    python3 "$here/sitl_rest.py" 127.0.0.1 5761
done
