"""Generation of machine code only for kernels whose address is used.

By default numba generates the machine code of every kernel. The kernels that call a kernel contain
its LLVM code, so its own machine code is executed only if Python calls it or if it is linked. This
module does not change the code of any kernel, so kernels on disk do not depend on it.
"""

from typing import Any

from numba.core.codegen import JITCPUCodegen
from numba.core.environment import lookup_environment

from omni_core.compilation.calls import KernelLibrary


class _LazyLibrary(KernelLibrary):
    """The code of a kernel, whose machine code is generated when its address is requested."""

    _generated = False

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True
        if getattr(self, "_compiled_object", None):  # loaded from the cache
            super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> Any:
        """Return the address of a function; 0 if this library does not define it."""
        self._ensure_finalized()
        defined = (function.name for function in self.get_defined_functions())
        if not self._generated and name in defined:
            self._generated, self._shared_module = True, None
            super()._finalize_final_module()
            for variable in self._final_module.global_variables:
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self._codegen.set_env(variable.name, environment)
        return super().get_pointer_to_function(name)

    def _get_compiled_object(self) -> Any:
        return self._compiled_object  # None without machine code


def defer_machine_code() -> None:
    """Let numba generate the machine code of a kernel when its address is first requested."""
    set_environment = JITCPUCodegen.set_env

    def set_if_used(codegen: JITCPUCodegen, name: str, environment: Any) -> None:
        if codegen._engine.get_global_value_address(name):
            set_environment(codegen, name, environment)

    JITCPUCodegen.set_env = set_if_used
    JITCPUCodegen._library_class = _LazyLibrary
