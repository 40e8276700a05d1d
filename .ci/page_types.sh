#!/usr/bin/env bash
# Check the types of the page of the desk (JSDoc). Needs npm; where TypeScript cannot be had, the check is left out.
set -euo pipefail
cd "$(dirname "$0")/.."
place=.venv/typescript
if ! [ -x "$place/node_modules/.bin/tsc" ]; then
    if ! npm install --prefix "$place" --no-audit --no-fund --silent typescript@5.9.3 > /dev/null 2>&1; then
        echo "TypeScript cannot be installed; the types of the page are not checked"
        exit 0
    fi
fi
"$place/node_modules/.bin/tsc" -p desk/static/jsconfig.json
