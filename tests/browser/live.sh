#!/bin/sh
# Watches flights with `gerono view` in a real, headless Chromium, and uses the page as a person would.
#
#     tests/browser/live.sh GERONO [PICTURES]
#
# GERONO is the program. Checks that all parts are filled and follow the flight, that the page pauses, tells of a service that
# dies, and fits on a desktop and on a phone; and prints how long after a sample it was drawn. Pictures go to target/browser/live;
# or to the folder PICTURES, and then a laboratory is watched too: `tests/browser/live.sh target/release/gerono docs/figures/live`
# makes those of docs/live_view.md. browser.sh says which browser.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
    exit 2
fi
gerono=$(cd "$(dirname "$1")" && pwd)/$(basename "$1")

what="the live page was not used"
. "$here/browser.sh"
pictures=${2:-$place/live}
mkdir -p "$pictures"

# Neither the runs of others are found, nor is this one by them.
work=$(mktemp -d)
export XDG_RUNTIME_DIR="$work" GERONO_RUNS="$work"
"$gerono" view --follow --port 0 >"$work/view" &
view=$!
trap 'kill -INT $view; wait $view || true; rm -rf "$work"' EXIT
until grep -q http: "$work/view" 2>/dev/null; do
    kill -0 $view
    sleep 0.1
done

address=$(sed -n 's/.*\(http:.*\)/\1/p' "$work/view")
node "$place/live.mjs" "$address" "$gerono" "$root/scenarios" "$work" "$pictures" ${2:+laboratory}
