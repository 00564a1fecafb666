#!/bin/bash
# A sweep on as many machines as Slurm gives: sbatch --nodes=4 examples/cluster/slurm.sh
#
# Wanted: an environment with iplw[ray] that all machines see (VENV), and a directory that all see (where sbatch is called).
# `ray symmetric-run` (Ray 2.49 or later) starts Ray on every machine, runs the command on the first and ends with it. A job
# that Slurm puts back into its queue begins the sweep anew; a machine that is lost meanwhile costs its units only.
#SBATCH --job-name=iplw-sweep
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=8
# Ray is stopped at the end by `ray stop`, which stops any other of yours on the same machine.
#SBATCH --exclusive
#SBATCH --time=01:00:00

set -euo pipefail

VENV=${VENV:-$SLURM_SUBMIT_DIR/.venv}
PORT=${PORT:-6379}
export PATH="$VENV/bin:$PATH"
export RAY_USAGE_STATS_ENABLED=0

first=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)
# Ray wants numbers, not names.
address=$(srun --nodes=1 --ntasks=1 --nodelist="$first" hostname --ip-address | awk '{print $1}'):$PORT

# A node killed by what it computes must not end the others' step.
srun --kill-on-bad-exit=0 ray symmetric-run \
    --address "$address" --min-nodes "$SLURM_JOB_NUM_NODES" --num-cpus "$SLURM_CPUS_PER_TASK" -- \
    python "$SLURM_SUBMIT_DIR/examples/cluster/sweep.py" --seeds 16 --out "$SLURM_SUBMIT_DIR/sweep.csv"
