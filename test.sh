#!/usr/bin/env bash
# Lint, types and tests. Arguments go on to pytest: ./test.sh -m "not slow"
set -euo pipefail
cd "$(dirname "$0")"
scripts/setup-venv dev
scripts/lint
# small matrices: threads of the linear algebra only wait for one another
export OPENBLAS_NUM_THREADS=1
case "$*" in *tests/*) exec .venv/bin/pytest "$@" ;; esac
# what runs in real time has the machine to itself
status=0
.venv/bin/pytest -n 2 --dist loadfile --ignore tests/hil/realtime "$@" || status=$?
[ "$status" = 5 ] && status=0 # no test of this part was asked for
.venv/bin/pytest tests/hil/realtime "$@" || { code=$?; [ "$code" = 5 ] || status=$code; }
exit "$status"
