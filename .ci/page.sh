#!/usr/bin/env bash
# Check types (JSDoc) and rules of the page of the desk. Needs node and npm; where they or the tools cannot be had, it says so.
set -euo pipefail
cd "$(dirname "$0")/.."
place=$PWD/.venv/page-tools
for needed in node npm; do
    command -v "$needed" > /dev/null || { echo "$needed is missing; types and rules of the page are not checked"; exit 0; }
done
if ! [ -x "$place/node_modules/.bin/tsc" ] || ! [ -x "$place/node_modules/.bin/eslint" ]; then
    if ! npm install --prefix "$place" --no-audit --no-fund --silent typescript@5.9.3 eslint@9.39.5 @eslint/js@9.39.5 > /dev/null 2>&1; then
        echo "TypeScript and ESLint cannot be installed; types and rules of the page are not checked"
        exit 0
    fi
fi
"$place/node_modules/.bin/tsc" -p desk/static/jsconfig.json
PAGE_TOOLS=$place "$place/node_modules/.bin/eslint" --config .ci/page_rules.mjs desk/static/js
