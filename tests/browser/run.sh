#!/bin/sh
# Opens a report in a real, headless Chromium and uses it as a person would.
#
#     tests/browser/run.sh REPORT.html [SCREENSHOTS]
#
# Checks that nothing is asked of a network, nothing goes wrong, all panels are drawn within a second, zoom is one for
# all panels, and the 3D view turns. Pictures go to the folder SCREENSHOTS (target/browser/screenshots
# unless stated). browser.sh says which browser.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
    exit 2
fi

what="the report was not opened"
. "$here/browser.sh"
exec node "$place/check.mjs" "$1" "${2:-$place/screenshots}"
