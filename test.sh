#!/usr/bin/env bash
# Sets up a fresh machine, then lint, types and tests: the core, each behaviour of it once, ten
# minutes on two cores.
#   ./test.sh --all       all that CI runs: extensions, references, tables of cases, browser, bundles
#   ./test.sh [--all] …   what follows goes on to pytest, such as tests/firmware or -k trigger
set -euo pipefail
cd "$(dirname "$0")"
set=dev tier="not slow"
if [ "${1:-}" = --all ]; then
    shift
    set=judges tier="not long"
fi
scripts/setup-venv "$set"
# small matrices: threads of the linear algebra only wait for one another
export OPENBLAS_NUM_THREADS=1
# each of thousand starts would compile every module that it imports
unset PYTHONDONTWRITEBYTECODE
case "$*" in *tests/*) exec .venv/bin/pytest "$@" ;; esac
scripts/lint ruff format codespell shellcheck
types=$(mktemp)
trap 'rm -f "$types"' EXIT
scripts/lint mypy >"$types" 2>&1 &
checker=$! code=0
# compiled once, not by each of the workers; a verdict on a tenth of a second is none
.venv/bin/canroll run double_lane_change --duration 0.1 --json >/dev/null || true
.venv/bin/pytest -n 2 --dist loadfile --durations=10 --durations-min=1 -m "$tier" "$@" || code=$?
if ! wait "$checker"; then
    cat "$types"
    [ "$code" != 0 ] || code=1
fi
exit "$code"
