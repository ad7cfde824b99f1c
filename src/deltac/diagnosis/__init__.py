"""What a motion's energy balance means: verdicts, findings, audits of logs, studies over steps.

Users find the names in `deltac`. Here each is imported from its own module, so that an audit loads neither
studies nor repairs.
"""
