"""Files and folders on disk: read only where they are regular files, written as a whole, held by one process."""

from ensemble_ctrl.core.storage.exchange import exchange
from ensemble_ctrl.core.storage.hold import HIDDEN, claim, hidden_name, hold, release, sweep
from ensemble_ctrl.core.storage.lines import Lines
from ensemble_ctrl.core.storage.reading import NotRegular, read_regular
from ensemble_ctrl.core.storage.writing import encoded, open_new, put_file, whole_file

__all__ = [
    "HIDDEN",
    "Lines",
    "NotRegular",
    "claim",
    "encoded",
    "exchange",
    "hidden_name",
    "hold",
    "open_new",
    "put_file",
    "read_regular",
    "release",
    "sweep",
    "whole_file",
]
