#!/usr/bin/env bash
# The pages of `rebond compare` and `rebond lecture` in a real browser, and their figures by NumPy and flip-evaluator.
# Where there is no Chromium they are skipped, which the last line says; with REQUIRE_BROWSER=1 that is a failure.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
target=${CARGO_TARGET_DIR:-target} tests=crates/rebond-cli/tests/pages

if ! command -v chromium >/dev/null && ! command -v chromium-browser >/dev/null && ! command -v google-chrome >/dev/null; then
  if [[ -n ${REQUIRE_BROWSER-} ]]; then
    echo "the pages' tests need Chromium: apt-get install chromium" >&2
    exit 1
  fi
  count=$(grep -c '    def test_' "$tests/test_pages.py")
  echo "the pages' tests are skipped: there is no Chromium"
  echo "test result: ok. 0 passed; 0 failed; $count ignored;"
  exit
fi

venv=$target/pages-venv
if ! cmp -s "$tests/requirements.txt" "$venv/installed.txt"; then
  "${PYTHON:-python3}" -m venv --clear "$venv"
  "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$tests/requirements.txt"
  cp "$tests/requirements.txt" "$venv/installed.txt"
fi
"${CARGO:-cargo}" build --quiet -p rebond-cli
REBOND=$(realpath "$target/debug/rebond") PYTHONDONTWRITEBYTECODE=1 "$venv/bin/python" "$tests/test_pages.py"
