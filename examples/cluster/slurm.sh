#!/bin/bash
# A sweep on all machines that Slurm allocates: sbatch --nodes=4 examples/cluster/slurm.sh
#
# Requires an environment with iplw[ray] on a shared file system (VENV), and a shared working directory (where sbatch is called).
# `ray symmetric-run` (Ray 2.49 or later) starts Ray on every machine, runs the command on the first and stops with it. A requeued
# job restarts the sweep; if a machine is lost, only its tasks are retried.
#SBATCH --job-name=iplw-sweep
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=8
# At the end `ray stop` is called, which also stops your other Ray instances on the same machine.
#SBATCH --exclusive
#SBATCH --time=01:00:00

set -euo pipefail

VENV=${VENV:-$SLURM_SUBMIT_DIR/.venv}
PORT=${PORT:-6379}
export PATH="$VENV/bin:$PATH"
export RAY_USAGE_STATS_ENABLED=0

first=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)
# Ray requires an IP address.
address=$(srun --nodes=1 --ntasks=1 --nodelist="$first" hostname --ip-address | awk '{print $1}'):$PORT

# A killed node must not end the step on the others.
srun --kill-on-bad-exit=0 ray symmetric-run \
    --address "$address" --min-nodes "$SLURM_JOB_NUM_NODES" --num-cpus "$SLURM_CPUS_PER_TASK" -- \
    python "$SLURM_SUBMIT_DIR/examples/cluster/sweep.py" --seeds 16 --out "$SLURM_SUBMIT_DIR/sweep.csv"
