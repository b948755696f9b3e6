"""Arguments from Python: what is plain is read, the rest is refused at the call by "expected .., got ..".

A text is read as in a problem file: ``"20 s"`` for a duration, ``"G avoid(post)"`` for a task.
"""

from ensemble_ctrl.problem.arguments.readers import (
    distributions_of,
    mapping_of,
    names_of,
    numbers_by_name,
    obstacles_of,
    quantity_of,
    regions_of,
    task_of,
)

__all__ = [
    "distributions_of",
    "mapping_of",
    "names_of",
    "numbers_by_name",
    "obstacles_of",
    "quantity_of",
    "regions_of",
    "task_of",
]
