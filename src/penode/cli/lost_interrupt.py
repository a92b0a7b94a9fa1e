"""Ctrl-C that comes where Python can raise nothing, as in a library's collection of garbage."""

import _thread
import sys
import threading

#: Seconds after which it is raised again, where the program then is.
_LATER = 0.05


def raise_lost_interrupts() -> None:
    """Raise an interrupt again that came inside a destructor or a callback.

    Python drops an exception there and prints it; what else it drops is printed as before.
    """
    sys.unraisablehook = _dropped


def _dropped(dropped: "sys.UnraisableHookArgs") -> None:
    if not issubclass(dropped.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(dropped)
        return
    timer = threading.Timer(_LATER, _thread.interrupt_main)
    timer.daemon = True
    timer.start()
