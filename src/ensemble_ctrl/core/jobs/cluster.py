"""Where units are computed: ``local``, ``local:N`` or the address of a Dask scheduler."""

from __future__ import annotations

import os
import re

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.jobs.processes import Processes, cores
from ensemble_ctrl.core.jobs.unit import Backend
from ensemble_ctrl.core.values import expect

WANTED = "local, local:N or tcp://HOST:PORT"


@dataclass(frozen=True)
class Cluster:
    """A parsed address.

    Attributes
    ----------
    address : str
        Of the Dask scheduler; empty for processes of this machine.
    workers : int
        How many processes; 0 on Dask.
    """

    address: str = ""
    workers: int = 0

    @classmethod
    def parse(cls, text: str) -> Cluster:
        """Read an address.

        Raises
        ------
        ProblemError
            If it is none.

        Examples
        --------
        >>> Cluster.parse("local:3"), Cluster.parse("tcp://10.0.0.7:8786").address
        (Cluster(address='', workers=3), 'tcp://10.0.0.7:8786')
        """
        local = re.fullmatch(r"local(?::(\d{1,4}))?", expect("cluster", text, str, WANTED))
        if local and local[1] != "0":
            return cls(workers=int(local[1]) if local[1] else cores())
        if local or not re.fullmatch(r"(tcp|tls)://[\w.\[\]:-]+:\d+", text):
            raise ProblemError(f"cluster: expected {WANTED}, got {text!r}")
        return cls(address=text)

    def backend(self) -> Backend:
        """Where units are computed.

        Raises
        ------
        UnsupportedError
            On Windows; for Dask, if it is not installed.
        WorkerError
            If there is no scheduler at the address.
        """
        if os.name == "nt":
            raise UnsupportedError("cluster: expected Linux or macOS, got Windows, where pipes can't be waited for")
        if not self.address:
            return Processes(self.workers)
        from ensemble_ctrl.core.jobs.dask import Dask

        return Dask.connected(self.address)
