# Source this in bash. `step` runs one step of a target of make, `finish` ends the target.

failures=""

# step NAME USUAL REMEDY COMMAND...: tells the step as it begins and how long it usually takes, and
# keeps its output in runs/log. Its failure is told by `finish`, as the last lines.
step() {
    local name=$1 usual=$2 remedy=$3 log="runs/log/$1.log" status=0
    shift 3
    mkdir -p runs/log
    echo "$name: usually $usual; log: $log"
    "$@" > >(tee "$log") 2>&1 || status=$?
    wait $! || true # for tee
    [ $status -eq 0 ] || failed "$name" "$remedy" "$log"
    return $status
}

# failed NAME REMEDY LOG: a step failed; its reasons are the failed tests, or the end of its log.
failed() {
    failures+="error: $1 failed:"$'\n'
    failures+=$({ grep -E '^(FAILED|ERROR) ' "$3" || tail -n 5 "$3"; } | tail -n 10 | sed 's/^/  /')
    failures+=$'\n'"try: $2"$'\n'"log: $3"$'\n'
}

finish() {
    printf %s "$failures" >&2
    [ -z "$failures" ]
}
