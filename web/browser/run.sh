#!/bin/sh
# The page's unit tests, and its end-to-end tests in Chromium. Without Node or Chromium they are skipped with a message, or fail
# if CI=true.  sh web/browser/run.sh PYTHON
set -eu
cd "$(dirname "$0")"

skip() {
	echo "test-web skipped: $1"
	[ "${CI:-}" != true ] || exit 1
	exit 0
}

command -v npm >/dev/null || skip "no Node (apt-get install nodejs npm)"
sh chromium.sh
command -v chromium >/dev/null || skip "no Chromium (apt-get install chromium)"
make -C ../.. --no-print-directory web-check
exec "$1" -m pytest -q -p no:cacheprovider -n 2 -rA --no-header .
