# %% [markdown]
# # Tasks and guarantees
#
# What a fleet can be asked to do, and for whom it is then sure: visits in order, choices, doors, and the difference
# between a plan for the *average* robot and one for *every* robot.
#
# ## A task is a formula
#
# `F[a, b]` is "at some time in the window", `G` "always", `U` "until", with `and`, `or`, `not`. Here the fleet
# fetches a key before it passes the door, and then stays in the room behind it:

# %%
import ensemble_ctrl as ec

TEXT = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [0, 1], omega: [-2, 2]}
horizon: {duration: 10 s, steps: 25}
regions:
  key: {box: [[0.6, 1.4], [0.9, 1.7]]}
  door: {box: [[2.0, 2.2], [-0.5, 0.5]]}
  room: {box: [[2.4, 3.8], [-0.7, 0.9]]}
obstacles:
  upper: {box: [[2.0, 2.2], [0.5, 2.2]]}
  lower: {box: [[2.0, 2.2], [-1.6, -0.5]]}
task: "not in(door) U in(key) and F[8, 9] G[0, 1] in(room) and G avoid(obstacles)"
"""
problem = ec.load_text(TEXT, name="door")
problem

# %%
plan = ec.plan(problem)
plan

# %% [markdown]
# ## Robustness: by how much
#
# The value of a formula is a distance in metres: positive if it holds, negative if it fails. The fleet's value is
# that of its worst robot.

# %%
run = plan.replay(members=5_000, substeps=5)
value, worst = run.worst
print(f"the worst of {run.members} robots does the task with {value:.3f} m to spare")
worst

# %% [markdown]
# Mistakes in a formula are found before anything is solved, with their place:

# %%
try:
    ec.load_text(TEXT.replace("in(key)", "in(kay)"), name="door")
except ec.ConfigError as error:
    print(error)

# %% [markdown]
# ## For whom?
#
# Constraints on the *moments* of the fleet, as in the paper, are necessary: a fleet that keeps out of an obstacle
# satisfies them. They are not sufficient: in effect the mean robot keeps out. Around a corner, that is not enough:

# %%
corner = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.8, 1.2]}}
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 5 s, steps: 20}
regions: {goal: {box: [[2.4, 4.0], [0.2, 1.8]]}}
obstacles: {block: {box: [[1.0, 1.6], [-0.2, 0.5]]}}
task: F[4, 5] in(goal) and G avoid(block)
verify: {certificate: false, members: 1000}
"""
plans = {}
for guarantee in ("moment", "hull"):
    problem = ec.load_text(corner, "corner", [f"solve.guarantee={guarantee}"])
    plans[guarantee] = ec.plan(problem, check=False)
for guarantee, found in plans.items():
    run = found.replay(members=5_000, substeps=10)
    share = 100 * run.violating.mean()
    print(f"{guarantee:<7} {share:5.1f} % violate it; proven for all: {found.certify().proven}")

# %%
import matplotlib.pyplot as plt

_, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for ax, (guarantee, found) in zip(axes, plans.items(), strict=True):
    found.plot(ax=ax)
    ax.set_title(f"guarantee: {guarantee}")

# %% [markdown]
# `hull` is the default: every robot of the model, through whole steps. Whatever was used to find a plan, the
# certificate judges it by itself: it takes the problem and the commands, and nothing of how they were found.
#
# ## What a proof says, and what it does not
#
# *Yes* means: every robot with a traction in the range that follows the model exactly keeps out of the block by at
# least this distance, at every instant. A *no* comes with a robot that violates the task; it can be replayed:

# %%
proof = plans["moment"].certify()
print(proof.counter_example)
shown = [proof.counter_example.parameters]
closest = plans["moment"].replay(parameters=shown, substeps=200).clearances[0]
print(f"replayed: {-closest.distance:.4f} m inside the block at t = {closest.time:.2f} s")
assert closest.distance < 0

# %% [markdown]
# A plan is not good for ever wider fleets. Asking one plan about several ranges says how much room it has:

# %%
for half in (0.2, 0.25, 0.3, 0.4):
    proof = plans["hull"].certify({"traction": ec.Interval(1 - half, 1 + half)})
    bound = min(proof.clearance, proof.robustness)
    print(f"{1 - half:.2f} to {1 + half:.2f}: {proof.proven:<9} {bound:+.3f} m")

# %% [markdown]
# ## The whole fleet at once
#
# `mean(...)` asks something of the mean robot, `share(p, ...)` of a part of the fleet:

# %%
mean = ec.load_text(corner, "mean", ["task=G avoid(block) and F[4, 5] mean(in(goal))"])
found = ec.plan(mean)
found.certify()
