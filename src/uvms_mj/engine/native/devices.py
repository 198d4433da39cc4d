"""Where a fleet computes: a GPU, through the driver of CUDA, or this processor.

Both have memory for words of 8 bytes, copies to and from it, and calls of the entries of a
:class:`.fleet_code.FleetCode`.
"""

import contextlib
import ctypes
import importlib
import itertools
import os
import threading
import weakref
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import llvmlite.binding as llvm
import numpy as np

from ...compiler.targets import PTX, Target
from ...errors import InputError, needs_extra
from .compilation import link
from .fleet_code import ENTRIES, FleetCode, symbol_of

BLOCK = 64
"""Threads of a block of a GPU."""


class Processor:
    """This processor, on several threads."""

    name: ClassVar[str] = "cpu"
    target = Target(llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads or (
            len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        )
        self._pool = ThreadPoolExecutor(self.threads)

    def load(self, code: FleetCode) -> dict[str, Any]:
        """The entries of code by their names."""
        self.target.machine()
        addresses = link(code.code, [symbol_of(entry) for entry in ENTRIES], [])  # of the C library at most
        assert addresses is not None
        kind = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 8)
        return {entry: kind(address) for entry, address in zip(ENTRIES, addresses, strict=True)}

    def array(self, shape: tuple[int, ...]) -> np.ndarray:
        return np.zeros(shape)

    def address(self, array: np.ndarray) -> int:
        return array.ctypes.data

    def put(self, numbers: np.ndarray, array: np.ndarray) -> None:
        array.view(np.int64)[...] = numbers.view(np.int64)

    def get(self, array: np.ndarray) -> np.ndarray:
        return array.copy()

    def view(self, array: np.ndarray, first: int, shape: tuple[int, ...], strides: tuple[int, ...], kind: str) -> Any:
        """An array from the number ``first`` on, with strides in numbers."""
        flat = array.reshape(-1)[first:].view(kind)
        return np.lib.stride_tricks.as_strided(flat, shape, [8 * each for each in strides])

    def call(self, entry: Any, table: np.ndarray, rooms: int, signals: np.ndarray, runs: int, n: int) -> None:
        """Call an entry of all runs."""
        given = table.ctypes.data, rooms, signals.ctypes.data, runs, runs, n
        edges = [runs * k // self.threads for k in range(self.threads + 1)]
        parts = itertools.pairwise(edges)
        list(self._pool.map(lambda part: entry(*given, *part), parts))

    def close(self) -> None:
        self._pool.shutdown()


class Gpu:
    """The first GPU of this machine.

    Raises:
        InputError: there is none, or its driver or the package for it is missing.
    """

    name: ClassVar[str] = "gpu"
    target = PTX
    _lock = threading.Lock()

    def __init__(self) -> None:
        with needs_extra("gpu"):
            driver = importlib.import_module("cuda.bindings.driver")
        self.driver: Any = driver
        try:
            with self._lock:
                self._checked(driver.cuInit(0))
                self.device = self._checked(driver.cuDeviceGet(0))
                self._context = self._checked(driver.cuDevicePrimaryCtxRetain(self.device))
        except (InputError, RuntimeError) as error:  # of cuda.bindings without a driver's library
            raise InputError(f"no GPU: {str(error).splitlines()[0]}; the engine free_body needs none") from None
        with self.current():
            name = self._checked(driver.cuDeviceGetName(128, self.device))
            attribute = driver.CUdevice_attribute
            major, minor = (
                self._checked(driver.cuDeviceGetAttribute(each, self.device))
                for each in (
                    attribute.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR,
                    attribute.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR,
                )
            )
        self.label = name.split(b"\0")[0].decode()
        if (major, minor) < (9, 0):
            raise InputError(f"no GPU of compute capability 9.0 or later: {self.label} has {major}.{minor}")

    def _checked(self, answer: Any) -> Any:
        error, *found = answer
        if int(error) != 0:
            said, text = self.driver.cuGetErrorString(error)
            what = text.decode() if int(said) == 0 and text else str(error)
            raise InputError(f"the GPU's driver says: {what}")
        return found[0] if found else None

    @contextlib.contextmanager
    def current(self) -> Iterator[None]:
        """Let the thread use this GPU."""
        self._checked(self.driver.cuCtxPushCurrent(self._context))
        try:
            yield
        finally:
            self.driver.cuCtxPopCurrent()

    def load(self, code: FleetCode) -> dict[str, Any]:
        """The kernels of code by the names of its entries."""
        with self.current():
            module = self._checked(self.driver.cuModuleLoadDataEx(code.code + b"\0", 0, [], []))
            get = self.driver.cuModuleGetFunction
            return {entry: self._checked(get(module, symbol_of(entry).encode())) for entry in ENTRIES}

    def registers(self, kernel: Any) -> tuple[int, int]:
        """Registers of a thread of a kernel, and the bytes that it has besides."""
        attribute = self.driver.CUfunction_attribute
        with self.current():
            return tuple(
                self._checked(self.driver.cuFuncGetAttribute(each, kernel))
                for each in (attribute.CU_FUNC_ATTRIBUTE_NUM_REGS, attribute.CU_FUNC_ATTRIBUTE_LOCAL_SIZE_BYTES)
            )  # type: ignore[return-value]  # two of them

    def array(self, shape: tuple[int, ...]) -> "DeviceMemory":
        return DeviceMemory(self, shape)

    def address(self, array: "DeviceMemory") -> int:
        return array.address

    def put(self, numbers: np.ndarray, array: "DeviceMemory") -> None:
        numbers = np.ascontiguousarray(numbers)
        if numbers.size:
            with self.current():
                self._checked(self.driver.cuMemcpyHtoD(array.address, numbers.ctypes.data, numbers.nbytes))

    def get(self, array: "DeviceMemory") -> np.ndarray:
        found = np.empty(array.shape)
        if found.size:
            with self.current():
                self._checked(self.driver.cuMemcpyDtoH(found.ctypes.data, array.address, found.nbytes))
        return found

    def view(
        self, array: "DeviceMemory", first: int, shape: tuple[int, ...], strides: tuple[int, ...], kind: str
    ) -> "DeviceArray":
        """An array from the number ``first`` on, with strides in numbers."""
        return DeviceArray(array, array.address + 8 * first, shape, strides, kind)

    def call(self, entry: Any, table: "DeviceMemory", rooms: int, signals: "DeviceMemory", runs: int, n: int) -> None:
        """Call an entry of all runs, and wait for it."""
        kinds = (*[ctypes.c_void_p] * 3, *[ctypes.c_longlong] * 3)
        given = (table.address, rooms, signals.address, runs, runs, n), kinds
        with self.current():
            blocks = -(-runs // BLOCK)
            self._checked(self.driver.cuLaunchKernel(entry, blocks, 1, 1, BLOCK, 1, 1, 0, 0, given, 0))
            self._checked(self.driver.cuCtxSynchronize())

    def close(self) -> None:
        """Memory is freed when nobody uses it any more."""


class DeviceMemory:
    """Words in the memory of a GPU, an array of 8 bytes each. They are freed when nobody uses them any more."""

    def __init__(self, gpu: Gpu, shape: tuple[int, ...]) -> None:
        self.gpu, self.shape = gpu, shape
        self.address = 0
        size = 8 * int(np.prod(shape, dtype=int))
        if size:
            with gpu.current():
                self.address = int(gpu._checked(gpu.driver.cuMemAlloc(size)))
                gpu._checked(gpu.driver.cuMemsetD8(self.address, 0, size))
            weakref.finalize(self, _free, gpu, self.address)


def _free(gpu: Gpu, address: int) -> None:
    with contextlib.suppress(InputError), gpu.current():
        gpu.driver.cuMemFree(address)


_CUDA, _FLOAT, _INTEGER = 2, 2, 0
"""Kinds of devices and of numbers in DLPack."""


class _Tensor(ctypes.Structure):
    """DLTensor and DLManagedTensor of DLPack 0.8, one behind the other."""


_DELETER = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Tensor))
_Tensor._fields_ = [
    ("data", ctypes.c_void_p),
    ("device_type", ctypes.c_int32),
    ("device_id", ctypes.c_int32),
    ("ndim", ctypes.c_int32),
    ("code", ctypes.c_uint8),
    ("bits", ctypes.c_uint8),
    ("lanes", ctypes.c_uint16),
    ("shape", ctypes.POINTER(ctypes.c_int64)),
    ("strides", ctypes.POINTER(ctypes.c_int64)),
    ("byte_offset", ctypes.c_uint64),
    ("manager", ctypes.c_void_p),
    ("deleter", _DELETER),
]
_lent: dict[int, tuple[Any, ...]] = {}
"""The memory that others hold by DLPack, by the address of its tensor."""


@_DELETER
def _delete(tensor: Any) -> None:
    _lent.pop(ctypes.addressof(tensor.contents), None)


class DeviceArray:
    """An array of float64 or int64 in the memory of a GPU, without a copy.

    PyTorch, CuPy and JAX take it as it is, by DLPack: ``torch.from_dlpack(fleet.signals["nu"])``. It shows what the
    fleet has computed last. :meth:`numpy` is a copy in this machine's memory.
    """

    def __init__(
        self, memory: DeviceMemory, address: int, shape: tuple[int, ...], strides: tuple[int, ...], kind: str
    ) -> None:
        self._memory, self._address, self.shape, self._strides = memory, address, shape, strides
        self.dtype = np.dtype(kind)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"DeviceArray(shape={self.shape}, dtype={self.dtype}, {self._memory.gpu.label})"

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        strides = tuple(8 * each for each in self._strides)
        data = self._address, False
        return {"shape": self.shape, "typestr": self.dtype.str, "data": data, "strides": strides, "version": 3}

    def __dlpack_device__(self) -> tuple[int, int]:
        return _CUDA, int(self._memory.gpu.device)

    def __dlpack__(self, **_: Any) -> Any:
        n = len(self.shape)
        sizes, strides = ((ctypes.c_int64 * n)(*each) for each in (self.shape, self._strides))
        code = _FLOAT if self.dtype.kind == "f" else _INTEGER
        tensor = _Tensor(
            self._address, _CUDA, int(self._memory.gpu.device), n, code, 64, 1,
            ctypes.cast(sizes, ctypes.POINTER(ctypes.c_int64)), ctypes.cast(strides, ctypes.POINTER(ctypes.c_int64)),
            0, None, _delete,
        )  # fmt: skip
        _lent[ctypes.addressof(tensor)] = tensor, sizes, strides, self._memory
        capsule = ctypes.pythonapi.PyCapsule_New
        capsule.restype, capsule.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
        return capsule(ctypes.addressof(tensor), b"dltensor", None)

    def numpy(self) -> np.ndarray:
        """A copy in this machine's memory."""
        gpu = self._memory.gpu
        last = sum((n - 1) * stride for n, stride in zip(self.shape, self._strides, strict=True)) + 1
        flat = np.empty(last if self.shape and min(self.shape) else 0, self.dtype)
        if flat.size:
            with gpu.current():
                gpu._checked(gpu.driver.cuMemcpyDtoH(flat.ctypes.data, self._address, flat.nbytes))
        return np.lib.stride_tricks.as_strided(flat, self.shape, [8 * each for each in self._strides]).copy()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self.numpy() if dtype is None else self.numpy().astype(dtype)
