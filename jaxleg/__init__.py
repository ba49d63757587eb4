"""jaxleg: how should a quadruped stand and step on this ground to spend the least energy?

    import jaxleg as jl

The names are listed in `__init__.pyi`; a module is loaded when one of its names is first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
