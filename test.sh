#!/usr/bin/env bash
# Lint, types and tests. Arguments go on to pytest: ./test.sh -m "not slow"
set -euo pipefail
cd "$(dirname "$0")"
scripts/setup-venv dev
scripts/lint
# small matrices: threads of the linear algebra only wait for one another
export OPENBLAS_NUM_THREADS=1
case "$*" in *tests/*) exec .venv/bin/pytest "$@" ;; esac
exec .venv/bin/pytest -n 2 --dist loadfile "$@"
