#!/usr/bin/env bash
# The main job end to end: design, integers, ECU loop, CAN, vehicle, verdict. Needs python3 >= 3.11.
#   ./demo.sh [options of canroll run double_lane_change]
set -euo pipefail
cd "$(dirname "$0")"
scripts/setup-venv
exec .venv/bin/canroll run double_lane_change --out out "$@"
