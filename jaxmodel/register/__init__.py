"""Align views: one registration, thousands of starts, and what a sweep tells about itself."""

from jaxmodel.register.method import IcpMethod, Strategy, ZhangFilter
from jaxmodel.register.outcome import Outcome
from jaxmodel.register.sweep import Registration, Sweep, Trace, register, register_trace, sweep, sweep_chunks

__all__ = [
    "IcpMethod",
    "Outcome",
    "Registration",
    "Strategy",
    "Sweep",
    "Trace",
    "ZhangFilter",
    "register",
    "register_trace",
    "sweep",
    "sweep_chunks",
]
