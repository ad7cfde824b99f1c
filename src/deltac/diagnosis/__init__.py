"""What a motion's energy balance means: verdicts, findings, audits of logs, studies over steps.

Users find the names in `deltac`. Here each is imported from its own module, so that an audit loads neither
studies nor repairs.
"""

from __future__ import annotations

from deltac.calls.stubs import on_first_use

__all__, __getattr__, __dir__ = on_first_use(__name__, __file__)
