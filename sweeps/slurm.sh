#!/bin/bash
# Workers of the search as a Slurm array. Each task is one worker on one core; all share a PostgreSQL database.
#
#   export LAESI_STORAGE=postgresql://laesi@HOST/sweep
#   sbatch sweeps/slurm.sh                                  # from the clone, where .venv is
#
# The password is read from ~/.pgpass, or from PGPASSWORD. The server must allow three connections per task. The
# same command continues a search; tasks beyond the last trial end by themselves. Options of sweeps.run:
#
#   export LAESI_OPTIONS="--large large_minimalistic --weights-large FILE --weights-small FILE"
#
#SBATCH --job-name=laesi-sweep
#SBATCH --array=0-63
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --output=laesi-sweep-%A-%a.log
# A task that is pre-empted starts again; its trial is queued again at once.
#SBATCH --requeue
# SIGTERM to the worker 90 s before the time limit: it releases its trial, which does not count as a failure.
#SBATCH --signal=TERM@90
set -euo pipefail
: "${LAESI_STORAGE:?set it to postgresql://USER@HOST:PORT/DATABASE}"
# Options are words: the array keeps each of them whole.
read -r -a options <<< "${LAESI_OPTIONS:-}"
export PATH="$PWD/.venv/bin:$PATH"
exec srun python -m sweeps.run --storage "$LAESI_STORAGE" --folder "${LAESI_FOLDER:-runs/sweep}" \
    --workers 1 --threads 1 "${options[@]}"
