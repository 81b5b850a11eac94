#!/usr/bin/env bash
# A scheduler and workers by hand, then a run on them; what dask says goes to OUT.dask.log. Here all are on this machine; over several,
# run the line of the scheduler on one and that of the worker on each of the others, with the scheduler's name in place of 127.0.0.1 and
# without the worker's --host.
# Usage: by_hand.sh CAPTURE OUT [WORKERS]
set -euo pipefail
capture=$1 out=$2 workers=${3:-2} host=127.0.0.1 port=${CADTOF_PORT:-8786}
log=${out%/}.dask.log
trap 'kill $(jobs -p) 2>/dev/null' EXIT

dask scheduler --host "$host" --port "$port" --no-dashboard &>> "$log" &
dask worker "tcp://$host:$port" --host "$host" --nworkers "$workers" --nthreads 1 --no-dashboard &>> "$log" &

until (exec 3<>"/dev/tcp/$host/$port") 2>/dev/null; do sleep 0.2; done
cadtof resolve "$capture" -o "$out" --scheduler "tcp://$host:$port" --resume
