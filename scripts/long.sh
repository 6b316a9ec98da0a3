#!/usr/bin/env bash
# The full figures, hours rather than minutes; each result goes to docs/evidence/ with its command, commit and
# date. Committed are those that a page cites, and benchmarks, which scripts/ratios compares the next with.
#   scripts/long.sh [NAME ...]     tests worst_case benchmarks contract fuzz_firmware exchange
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/setup-venv judges
mkdir -p docs/evidence
export PATH="$PWD/.venv/bin:$PATH" COLUMNS=110

keep() {   # NAME COMMAND...: run, and keep what it prints
    local name=$1
    shift
    echo "long: $*" >&2
    {
        echo "commit   $(git rev-parse --short HEAD)$(git diff --quiet || echo ' with changes')"
        echo "date     $(date -u +%F)"
        echo "machine  $(nproc --all) cores, $(uname -m)"
        echo "command  $*"
        echo
        "$@" 2>&1
    } >"docs/evidence/$name.txt.part" || echo "exit code $?" >>"docs/evidence/$name.txt.part"
    mv "docs/evidence/$name.txt.part" "docs/evidence/$name.txt"
}

bound=(canroll timing --bound --ticks 100000)
for name in "${@:-tests worst_case benchmarks contract fuzz_firmware exchange}"; do
    for part in $name; do
        case $part in
            tests)
                keep long_tests pytest -m long -n 2 --dist loadfile --durations=0
                keep long_properties pytest -m hypothesis --hypothesis-profile=long -n 2 ;;
            worst_case)
                keep worst_case_lqr "${bound[@]}" --law lqr
                keep worst_case_lqg_delay "${bound[@]}" --law lqg_delay
                canroll design --law lqr --observer propagated --identification --bus 500k --out out/rls
                keep worst_case_covariance "${bound[@]}" --calibration out/rls/calibration.toml ;;
            benchmarks)
                for bench in benchmarks/bench_*.py; do
                    keep "$(basename "$bench" .py)" python "$bench"
                done
                scripts/ratios docs/evidence/bench_*.txt ;;
            contract)
                keep contract canroll compare --bus 500k --vehicle van_real --runs 200 ;;
            fuzz_firmware)
                keep fuzz_firmware python -m tools.fuzz_firmware --inputs 10000000
                keep fuzz_firmware_own_bus python -m tools.fuzz_firmware --inputs 1000000 \
                    --dbc examples/own_bus/own.dbc --map examples/own_bus/own.toml ;;
            exchange) keep exchange_equality pytest -n 0 -v -m slow tests/canroll/extensions/exchange ;;
            *) echo "long: unknown part '$part'" >&2; exit 2 ;;
        esac
    done
done
