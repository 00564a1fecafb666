"""The same episode as `episode.ts`, through a client that openapi-python-client made."""

import json
import sys

from iplw_generated import Client
from iplw_generated.api.tasks import list_families
from iplw_generated.api.worlds import (
    create_world,
    delete_world,
    get_world,
    reset_world,
    rollout_world,
    step_world,
)
from iplw_generated.models import CreateWorld, LatentsIn, Problem, ResetIn, RolloutIn, StepIn, StepOut

with Client(base_url=sys.argv[1], raise_on_unexpected_status=True) as client:
    families = [family.name for family in list_families.sync(client=client).families]
    world = create_world.sync(
        client=client, body=CreateWorld(task="bowling:002", latents=LatentsIn(friction=0.5))
    )
    start = reset_world.sync(world.id, client=client, body=ResetIn(seed=1))
    tried = rollout_world.sync(
        world.id, client=client, body=RolloutIn(actions=[1000 * k for k in range(32)])
    )
    chosen = [result.valid for result in tried.results].index(True)
    step = step_world.sync(world.id, client=client, body=StepIn(action=1000 * chosen))
    assert isinstance(step, StepOut)
    refused = step_world.sync(world.id, client=client, body=StepIn(action=[0.5, 0.5, 0.2]))
    assert isinstance(refused, Problem)
    delete_world.sync_detailed(world.id, client=client)
    gone = get_world.sync_detailed(world.id, client=client)

print(
    json.dumps(
        {
            "families": families,
            "task": start.info.task,
            "first": start.observation,
            "chosen": chosen,
            "observation": step.observation,
            "reward": step.reward,
            "terminated": step.terminated,
            "steps": step.info.steps,
            "refused": refused.status,
            "gone": gone.status_code.value,
        }
    )
)
