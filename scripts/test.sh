#!/usr/bin/env bash
# Runs the tests named by its arguments, folders or files, within the environment of env.sh.
#
# First those that start processes, three at a time on two cores: many of them wait. Then those of a
# machine in real time, each in a ROS domain and on a bus of its own, as many at a time as there are
# cores for that nobody else uses and that are fast enough. In the pauses of both the unit tests
# run, in the idle class of the scheduler, which gives way at once. The simulated crane, the driver
# and who commands it have real-time priority, and who watches them goes before other work (of the
# same session, where the kernel groups by it), where that is permitted; where it is not, other work
# on the same cores makes true faults. Nothing is tried twice.
set -euo pipefail
source "$(dirname "$0")/step.sh"

units=() others=()
for test; do
    if [[ $test == tests/unit* ]]; then units+=("$test"); else others+=("$test"); fi
done

remedy="the failed test alone: source scripts/env.sh && python -m pytest FILE::TEST"
some() { "$@" || [ $? -eq 5 ]; } # pytest ends with 5 where nothing is selected
one_file_each=(--dist loadfile --no-loadscope-reorder)
in_parallel=(python -m pytest "${one_file_each[@]}" -m "not realtime")
# Threads of linear algebra that wait for one another would take twice the time of the cores.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

if [ ${#others[@]} -eq 0 ]; then
    step unit_tests "some minutes" "$remedy" some "${in_parallel[@]}" -n 2 "${units[@]}" || true
    finish
    exit
fi

idle() { awk '/^cpu / { print $5 + $6 }' /proc/stat; } # time of all cores [1/100 s], since the start
echo "tests: 14 min on two fast cores, twice as long on slow ones"
before=$(idle)
sleep 2
free=$((($(idle) - before) / 2)) # % of a core
# What crane, driver, who commands and the test take: 40 % of a core that multiplies a million times
# in 14 ms.
slowness="from statistics import median; from timeit import repeat
print(round(40 / 0.014 * median(repeat('for i in range(1000000): i * i', number=1, repeat=9))))"
machine=$(python -c "$slowness") # % of a core
at_once=$((free > 2 * machine ? free / machine : 1))

if [ ${#units[@]} -gt 0 ]; then
    mkdir -p runs/log
    log=runs/log/unit_tests.log
    echo "unit_tests: beside all others, shown after them; log: $log"
    chrt --idle 0 "${in_parallel[@]}" -n 2 "${units[@]}" >"$log" 2>&1 &
    running=$!
    trap 'kill $running 2>/dev/null || true' EXIT
fi
step tests_with_processes "6 min on fast cores, 13 min on slow ones" "$remedy" \
    some "${in_parallel[@]}" -n 3 "${others[@]}" || true

echo "in real time: $at_once at a time; each takes $machine % of a core"
# To import the other files takes seconds. `nice` runs its command, too, where that is not permitted.
mapfile -t without < <(grep -rL --include="test_*.py" "pytest.mark.realtime" tests/integration)
in_real_time=(nice -n -10 python -m pytest -m realtime "${without[@]/#/--ignore=}")
step tests_in_real_time "7 min two at a time, twice as long one by one" "$remedy" \
    some "${in_real_time[@]}" "${one_file_each[@]}" -n "$at_once" "${others[@]}" || true
if [ ${#units[@]} -gt 0 ]; then
    echo "unit_tests: what is left of them"
    # Beside other work the idle class may get nothing; out of it, where that is permitted.
    for process in $running $(pgrep --parent "$running" || true); do
        chrt --all-tasks --other --pid 0 "$process" 2>/dev/null || true
    done
    tail -n +1 -f --pid="$running" "$log"
    some wait "$running" || failed unit_tests "$remedy" "$log"
fi
finish
