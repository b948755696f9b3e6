# %% [markdown]
# # Your own fleet
#
# Robots are never equal, and every fleet is unequal in its own way. Here: several parameters at once, how they are
# spread, measured robots, car-like robots, and what a fleet can be shaped into.
#
# ## Which parameters differ?
#
# `ensemble-plan models` lists the models with their commands and parameters:

# %%
from ensemble_ctrl.cli.app import invoke

_ = invoke(["models"])

# %% [markdown]
# We take the driven speed and the turn rate apart (wheels that slip do not slip equally in both), and place the
# robots by hand, to within 4 cm. The planner and the proof treat the ranges as a box: every combination counts.

# %%
import ensemble_ctrl as ec

TEXT = """
fleet:
  model: unicycle
  parameters:
    linear_traction: {range: [0.92, 1.08]}
    angular_traction: {range: [0.95, 1.05]}
    start_y: {range: [-4 cm, 4 cm]}
  start: {position: [0, 0], heading: 0 deg}
  radius: 10 cm
horizon: {duration: 5 s, steps: 20}
regions: {goal: {box: [[2.6, 4.0], [0.0, 1.2]]}}
obstacles: {post: {box: [[1.1, 1.5], [-0.6, 0.1]]}}
task: F[4, 5] in(goal) and G avoid(post)
verify: {members: 1000}
"""
plan = ec.plan(ec.load_text(TEXT, name="slipping"))
plan

# %%
certificate = plan.certify()
print(certificate.proven)
for name, (low, high) in certificate.ranges.items():
    print(f"  {name}: {low:.2f} to {high:.2f}")
assert certificate.proven == "yes"

# %% [markdown]
# ## How are they spread?
#
# The range says which robots there may be, and the plan holds for all of them. The *distribution* says how many there
# are of each; it enters the mean, the moments and the terminal cost. Here most robots are a little slow:

# %%
import matplotlib.pyplot as plt
import numpy as np

distributions = {
    "uniform": ec.Interval(0.92, 1.08),
    "Beta(2, 4)": ec.Beta(0.92, 1.08, 2, 4),
    "normal, cut off": ec.TruncatedNormal(0.92, 1.08, 1.0, 0.03),
    "two makes": ec.Mixture((ec.Interval(0.92, 0.96), 2), (ec.Interval(1.0, 1.08), 1)),
}
_, ax = plt.subplots(figsize=(6, 3), layout="constrained")
values = np.linspace(0.92, 1.08, 200)
for name, distribution in distributions.items():
    ax.plot(values, distribution.cdf(values), label=name)
ax.set(xlabel="traction", ylabel="share of the fleet below")
_ = ax.legend(frameon=False)

# %% [markdown]
# In a problem file: `linear_traction: {range: [0.92, 1.08], distribution: beta, a: 2, b: 4}`. The target below is
# met on average over this fleet, so the distribution moves the plan:

# %%
AIM = ["objective.terminal={target: [3.2, 0.6], weight: 20}", "objective.robustness=0"]
for distribution in ("beta, a: 2, b: 4", "beta, a: 4, b: 2"):
    spread = f"fleet.parameters.linear_traction={{range: [0.92, 1.08], distribution: {distribution}}}"
    found = ec.plan(ec.load_text(TEXT, "distribution", [*AIM, spread]))
    length = np.abs(found.controls[:, 0]).sum() * found.problem.step
    print(f"{distribution:<17} commanded path {length:.3f} m")

# %% [markdown]
# The first distribution has more slow robots than fast ones: they are told to drive further.
#
# ## Measured robots
#
# Numbers from your robots go in as they are, from a list, an array, or a CSV file (`samples: measured.csv`; a table
# of parameters that belong together is `samples: table.csv`):

# %%
measured = np.random.default_rng(1).normal(1.0, 0.02, 60).clip(0.93, 1.07)
samples = f"{{samples: {measured.round(3).tolist()}}}"
problem = ec.load_text(TEXT, "measured", [f"fleet.parameters.linear_traction={samples}"])
problem.fleet.parameters["linear_traction"]

# %%
ec.plan(problem)

# %% [markdown]
# ## Cars
#
# A bicycle model has no turning on the spot: the turn rate is $v \tan(\delta) / L$ with the steering angle $\delta$
# as command.

# %%
car = ec.load_text(
    """
fleet:
  model: bicycle
  wheelbase: 40 cm
  parameters: {traction: {range: [0.95, 1.05]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [0, 1.2], delta: [-30 deg, 30 deg]}
horizon: {duration: 6 s, steps: 24}
regions: {bay: {box: [[2.2, 3.2], [1.6, 2.6]]}}
obstacles: {kerb: {polygon: [[0.8, 0.4], [1.6, 0.4], [1.6, 1.0], [0.8, 1.6]]}}
task: F[5, 6] in(bay) and G avoid(kerb)
verify: {members: 1000}
""",
    name="parking",
)
parked = ec.plan(car)
parked

# %%
steepest = np.degrees(np.abs(parked.controls[:, 1]).max())
print(f"largest steering angle: {steepest:.1f} degrees")

# %% [markdown]
# ## How different may they be?
#
# The widest range for which a certified plan is found takes about ten plans, and some seconds: `ensemble-plan widest
# problem.yaml`, or `ensemble_ctrl.widest(car)`. For this car it is a traction of 0.53 to 1.47.
