# %% [markdown]
# # A first plan
#
# A fleet of unicycles drives around a crate into a goal. All robots receive the same commands; they differ in their
# *traction*, a factor between 0.9 and 1.1 on how fast they drive and turn. We plan one sequence of commands that
# brings every one of them there, and prove that it does.
#
# ## The problem
#
# A problem is a YAML text or file (`ec.load("problem.yaml")`): who moves, how long, what is on the map, what has to
# be done.

# %%
import ensemble_ctrl as ec

problem = ec.load_text(
    """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [0, 1], omega: [-1.5, 1.5]}
  radius: 5 cm
horizon: {duration: 8 s, steps: 32}
regions: {goal: {box: [[3.6, 4.8], [-0.2, 1.0]]}}
obstacles: {crate: {box: [[1.4, 2.2], [-0.6, 0.4]]}}
task: F[6, 8] in(goal) and G avoid(crate)
objective: {terminal: {target: [4.2, 0.4], weight: 2}}
""",
    name="crate",
)
problem

# %% [markdown]
# A notebook shows the map before anything is solved. The task reads: at some time between 6 s and 8 s be in the goal,
# and always avoid the crate. Every robot has to do it.
#
# ## Planning

# %%
plan = ec.plan(problem)
plan

# %% [markdown]
# The lines of the drawing are robots of different traction. `plan.controls` are the commands, one row for each step:
# speed in m/s and turn rate in rad/s. This is all that is sent to the robots.

# %%
plan.controls[:4].round(3)

# %% [markdown]
# ## Is it any good?
#
# A **replay** runs the commands on sampled robots, exactly, with code that shares nothing with the planner. It is an
# experiment: it speaks of the robots that it drew and the times that it looked at.

# %%
run = plan.replay(members=20_000, substeps=5)
run

# %%
run.worst

# %% [markdown]
# The **certificate** is a proof: for every traction in the range, and for every instant. Between the two numbers of
# an obstacle lies the true smallest distance.

# %%
certificate = plan.certify()
print("proven:", certificate.proven)
for bound in certificate.clearances:
    print(f"{bound.obstacle}: at least {bound.proven:.4f} m")
    print(f"a robot that was looked at: {bound.sampled:.4f} m at t = {bound.time:.2f} s")
print(f"the rest of the task holds with {certificate.robustness:.4f} m to spare")

# %% [markdown]
# It holds for what was asked. About a wider fleet it says no, and names a robot that shows why:

# %%
wider = plan.certify({"traction": ec.Interval(0.7, 1.3)})
print(wider.proven, wider.counter_example)
assert wider.proven == "no"

# %% [markdown]
# ## Keeping it
#
# `save` writes one file with the controls and the problem; `load` reads it back. (`ensemble-plan problem.yaml` writes
# a folder with figures, tables and the certificate.)

# %%
from pathlib import Path
from tempfile import TemporaryDirectory

with TemporaryDirectory() as folder:
    again = ec.Plan.load(plan.save(Path(folder) / "crate.npz"))
assert (again.controls == plan.controls).all()

# %% [markdown]
# ## When there is no plan
#
# With half the speed the goal can't be reached, and the problem is refused before anything is solved:

# %%
from dataclasses import replace

try:
    problem.with_(fleet=replace(problem.fleet, input_upper=[0.4, 1.5]))
except ec.ProblemError as error:
    print(error)

# %% [markdown]
# Other problems look possible and are not. This crate is so tall that the way round it takes longer than 8 s. The
# error carries what was found, and `suggest` looks for a change that helps: what it names was planned and proven.

# %%
crate = ec.Obstacle.box([[1.4, 2.2], [-3, 3]])
tall = problem.with_(steps=16, obstacles={"crate": (crate,)})
try:
    ec.plan(tall)
except ec.SolveError as error:
    print(error)
    for suggestion in error.plan.suggest().helps:
        print("it works with", suggestion.change)
