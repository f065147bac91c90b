#!/usr/bin/env bash
# Runs the tests named by its arguments, folders or files, within the environment of env.sh.
#
# First those that start processes, three at a time on two cores: many of them wait; what failed is
# tried once more, alone. Then those of a machine in real time, two at a time, each in a ROS domain
# and on a bus of its own. In their pauses the unit tests run, in the idle class of the scheduler,
# which gives way at once. The simulated crane, the driver and who commands it have real-time
# priority, and who watches them goes before other work (of the same session, where the kernel groups
# by it), where that is permitted; where it is not, other work on the same cores makes true faults:
# what failed in real time is tried once more in the end, alone, with processes of its own.
set -euo pipefail

units=() others=()
for test; do
    if [[ $test == tests/unit* ]]; then units+=("$test"); else others+=("$test"); fi
done

some() { "$@" || [ $? -eq 5 ]; } # pytest ends with 5 where nothing is selected
one_file_each=(--dist loadfile --no-loadscope-reorder)
in_parallel=(python -m pytest "${one_file_each[@]}" -m "not realtime")
# Threads of linear algebra that wait for one another would take twice the time of the cores.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

if [ ${#others[@]} -eq 0 ]; then
    some "${in_parallel[@]}" -n 2 "${units[@]}"
    exit
fi

some "${in_parallel[@]}" -n 3 "${others[@]}" || "${in_parallel[@]}" --last-failed "${others[@]}"
if [ ${#units[@]} -gt 0 ]; then
    log=$(mktemp)
    chrt --idle 0 "${in_parallel[@]}" -n 2 "${units[@]}" >"$log" 2>&1 &
    running=$!
    trap 'kill $running 2>/dev/null || true; rm -f "$log"' EXIT
fi
# To import the other files takes seconds. `nice` runs its command, too, where that is not permitted.
mapfile -t without < <(grep -rL --include="test_*.py" "pytest.mark.realtime" tests/integration)
in_real_time=(nice -n -10 python -m pytest -m realtime -o cache_dir=.pytest_cache/realtime "${without[@]/#/--ignore=}" "${others[@]}")
failed=0 status=0
"${in_real_time[@]}" "${one_file_each[@]}" -n 2 || failed=$?
if [ ${#units[@]} -gt 0 ]; then
    wait "$running" || status=$?
    cat "$log"
fi
case $failed in
0 | 5) ;;
1) "${in_real_time[@]}" --last-failed ;; # tests have failed
*) exit "$failed" ;;
esac
[ "$status" -eq 0 ] || [ "$status" -eq 5 ]
