#!/bin/sh
# Builds the Debian package and installs it into a clean Debian.
#
#     tests/packaging/deb.sh [SUITE]
#
# * In a Debian of essential packages alone, of SUITE (trixie unless stated): it brings what it needs; a member of its group gets
#   priority and memory; Fig. 1, flown from it as processes, has the digest that the README states; bash completes; nothing is
#   enabled; and nothing is left after a purge.
# * In a second one, with systemd, udev, man and lintian: none of them finds a fault.
#
# Both live in target/packaging, made at the first run by debootstrap, which needs root and a mirror ($MIRROR); each run works on
# copies. Without them the package is only unpacked and flown. What cannot be tried is SKIPPED, and the script ends with status 3.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
suite=${1:-trixie}
mirror=${MIRROR:-http://deb.debian.org/debian}
place=$target/packaging
skipped=

skip() {
    echo "SKIPPED: $1" >&2
    skipped=1
}

fail() {
    echo "$1" >&2
    exit 1
}

# debootstrap, unpacked in target/packaging unless it is installed.
bootstrap() {
    if command -v debootstrap >/dev/null; then
        debootstrap "$@"
        return
    fi
    if ! [ -e "$place/debootstrap/usr/sbin/debootstrap" ]; then
        rm -rf "$place/packages"
        mkdir -p "$place/packages"
        (cd "$place/packages" && apt-get download --quiet=2 -o APT::Sandbox::User="$(id -un)" debootstrap) || return 1
        dpkg -x "$place"/packages/debootstrap_*.deb "$place/debootstrap" || return 1
    fi
    DEBOOTSTRAP_DIR=$place/debootstrap/usr/share/debootstrap "$place/debootstrap/usr/sbin/debootstrap" "$@"
}

# `within FOLDER COMMAND…`: runs a command in the Debian of a folder, with processes, shared memory and mounts of its own, which end
# with it.
within() {
    # shellcheck disable=SC2016 # expanded by the inner shell
    timeout 600 unshare --mount --pid --ipc --fork --kill-child sh -eu -c '
        folder=$1
        shift
        mount -t proc proc "$folder/proc"
        mount --rbind /sys "$folder/sys"
        mount -t tmpfs tmpfs "$folder/dev/shm"
        exec chroot "$folder" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"
    ' sh "$@"
}

# `debian NAME PACKAGE…`: a Debian with these packages, made once.
debian() {
    name=$suite-$1
    shift
    [ -e "$place/$name/complete" ] && return
    [ "$(id -u)" = 0 ] || return 1
    rm -rf "$place/$name"
    mkdir -p "$place/$name"
    bootstrap --variant=minbase "$suite" "$place/$name/debian" "$mirror" >"$place/$name/log" 2>&1 || return 1
    within "$place/$name/debian" apt-get update >>"$place/$name/log" 2>&1 || return 1
    [ $# = 0 ] || within "$place/$name/debian" apt-get install --yes --no-install-recommends "$@" >>"$place/$name/log" 2>&1 || return 1
    touch "$place/$name/complete"
}

package=$("$root/packaging/debian/build.sh")
digest=$(sed -n 's/^\([0-9a-f]\{64\}\)$/\1/p' "$root/README.md")
mkdir -p "$place"
work=$(mktemp -d "$place/work.XXXXXX")
trap 'rm -rf "$work"' EXIT
trap 'exit 1' INT TERM

# Runs a command of the test in the clean Debian.
clean() {
    within "$work/clean" "$@"
}

# The same as the pilot, a member of the package's group who has logged in.
pilot() {
    clean su --login pilot --command "$1"
}

installed() {
    cp -a "$place/$suite-clean/debian" "$work/clean"
    cp "$package" "$work/clean/gerono.deb"
    clean apt-get install --yes --no-install-recommends /gerono.deb >"$work/log" 2>&1 || fail "$(cat "$work/log")"
    clean useradd --create-home --shell /bin/bash --groups gerono pilot
    if prlimit --rtprio=90 --memlock=unlimited true 2>/dev/null; then
        limits=$(pilot 'ulimit -r; ulimit -l' | tr '\n' ' ')
        [ "$limits" = "90 unlimited " ] || fail "a member of the group gerono has the limits $limits"
    else
        skip "root may not raise limits here (CAP_SYS_RESOURCE), so those of a pilot were not tried"
    fi
    flown=$(pilot 'gerono run /usr/share/gerono/scenarios/fig1.toml --quiet --out flight && gerono digest flight')
    [ "$flown" = "$digest" ] || fail "Fig. 1 has the digest $flown, the README says $digest"
    pilot 'gerono sweep plan /usr/share/gerono/scenarios/sweeps/fig1.toml --slurm' | grep -q sbatch || fail "a sweep cannot be planned"
    # shellcheck disable=SC2016 # expanded by the pilot's shell
    offered=$(pilot '. /usr/share/bash-completion/completions/gerono; COMP_WORDS=(gerono swee); COMP_CWORD=1; COMP_TYPE=9; _clap_complete_gerono gerono swee gerono; echo "${COMPREPLY[@]}"')
    [ "$offered" = sweep ] || fail "bash completes \`gerono swee\` to: $offered"
    enabled=$(find "$work/clean/etc/systemd" "$work/clean/etc/rc3.d" -name '*gerono*' 2>/dev/null)
    [ -z "$enabled" ] || fail "it is enabled: $enabled"
    clean apt-get purge --yes gerono >"$work/log" 2>&1 || fail "$(cat "$work/log")"
    rm "$work/clean/gerono.deb"
    left=$(find "$work/clean" -xdev -path "$work/clean/home" -prune -o -name '*gerono*' -print)
    [ -z "$left" ] || fail "this is left after a purge: $left"
    echo "$suite: installed, flown with the README's digest, completed by bash, and purged"
}

verified() {
    cp -a "$place/$suite-tools/debian" "$work/tools"
    cp "$package" "$work/tools/gerono.deb"
    # Nobody asked Debian for it.
    within "$work/tools" lintian --allow-root --fail-on error,warning --tag-display-limit 0 \
        --suppress-tags initial-upload-closes-no-bugs /gerono.deb
    within "$work/tools" dpkg --install /gerono.deb >"$work/log" 2>&1 || fail "$(cat "$work/log")"
    # It ignores what it does not understand, and says so.
    warnings=$(within "$work/tools" systemd-analyze verify gerono@laboratory.service 2>&1) || fail "$warnings"
    [ -z "$warnings" ] || fail "the unit: $warnings"
    if within "$work/tools" udevadm verify --help >/dev/null 2>&1; then
        within "$work/tools" udevadm verify --no-summary /usr/lib/udev/rules.d/60-gerono.rules
    else
        skip "udevadm of $suite verifies no rules"
    fi
    warnings=$(within "$work/tools" man --warnings --pager=cat gerono-sweep-run 2>&1 >/dev/null)
    [ -z "$warnings" ] || fail "the man page: $warnings"
    echo "$suite: no fault is found in the package, its unit, rules and man pages"
}

if debian clean && debian tools adduser lintian man-db systemd udev; then
    installed
    verified
else
    skip "there is no clean Debian here (root? a mirror? see $place/$suite-*/log); the package was only unpacked"
    dpkg -x "$package" "$work/unpacked"
    "$work/unpacked/usr/bin/gerono" run "$work/unpacked/usr/share/gerono/scenarios/fig1.toml" --quiet --out "$work/flight"
    flown=$("$work/unpacked/usr/bin/gerono" digest "$work/flight")
    [ "$flown" = "$digest" ] || fail "Fig. 1 has the digest $flown, the README says $digest"
fi
[ -z "$skipped" ] || exit 3
