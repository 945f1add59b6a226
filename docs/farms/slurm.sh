#!/bin/sh
# fantex plan world.glb -o world.plan --texels 16G
# job=$(sbatch --parsable slurm.sh)
# sbatch --dependency=afterok:"$job" --wrap "fantex merge world.plan *.part -o world.fan"
#SBATCH --array=1-64
#SBATCH --cpus-per-task=8
shards=64   # the whole array, also where single parts are submitted again
exec fantex bake world.plan --shard "$SLURM_ARRAY_TASK_ID/$shards" -o "$SLURM_ARRAY_TASK_ID.part" \
    --threads "$SLURM_CPUS_PER_TASK" --force
