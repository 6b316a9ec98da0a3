#!/usr/bin/env bash
# Lint, types and tests. Arguments go on to pytest: ./test.sh -m "not slow"
set -euo pipefail
cd "$(dirname "$0")"
scripts/setup-venv dev
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/mypy
exec .venv/bin/pytest "$@"
