# SPDX-License-Identifier: Apache-2.0
"""Eight numbers at once in compiled functions, one for each of eight demonstrations.

numba leaves it to LLVM whether a loop over an array's last axis becomes vector instructions, and for eight numbers it
does not. Here vector instructions are requested explicitly: `load` takes the last axis of an array as one value, with
which `+`, `*` and `/` calculate in each lane for itself, and `store` puts it back. A number beside such a value stands
for eight of it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, cast

from numba.core import types
from numba.core.cgutils import get_item_pointer, ir, unpack_tuple  # type: ignore[attr-defined]
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model
from numba.np.arrayobj import make_array

LANES = 8
"""Demonstrations that are gone through at once: as many doubles as the widest registers hold."""

Lanes = Any
"""The eight numbers as one value, which only compiled functions know."""

VECTOR = ir.VectorType(ir.DoubleType(), LANES)


def instruction(typed: Callable[..., Any]) -> Callable[..., Any]:
    """Let compiled functions call the intrinsic that `typed` declares: its types and its LLVM code."""
    return cast(Callable[..., Any], intrinsic(typed))


class LanesType(types.Type):
    """numba's name for the eight numbers."""

    def __init__(self) -> None:
        super().__init__("Lanes")


EIGHT = LanesType()


@register_model(LanesType)
class LanesModel(models.PrimitiveModel):
    """What LLVM makes of them."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@lower_cast(types.Float, LanesType)
def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    nothing, places = ir.Constant(VECTOR, ir.Undefined), ir.VectorType(ir.IntType(32), LANES)
    first = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(places, [0] * LANES))


@instruction
def repeat(typing: Any, value: Any) -> Any:
    """Eight times the same number."""
    return EIGHT(EIGHT), lambda context, builder, sig, values: values[0]


@infer_global(operator.add)
@infer_global(operator.iadd)
@infer_global(operator.mul)
@infer_global(operator.truediv)
class Arithmetic(AbstractTemplate):
    """Lanes with lanes, or with a number, make lanes."""

    def generic(self, given: Any, named: Any) -> Any:
        """The signature, if it is about lanes."""
        return signature(EIGHT, EIGHT, EIGHT) if EIGHT in given else None


def _lower(of_python: Any, of_llvm: str) -> None:
    @lower_builtin(of_python, EIGHT, EIGHT)
    def lowered(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return getattr(builder, of_llvm)(*values, flags=("contract",))  # products may be fused into sums


_lower(operator.add, "fadd")
_lower(operator.iadd, "fadd")
_lower(operator.mul, "fmul")
_lower(operator.truediv, "fdiv")


def _place(context: Any, builder: Any, kind: Any, array: Any, indices: Any) -> Any:
    """Where the last axis of the array lies at these indices of all others, which are not checked."""
    whole = [*unpack_tuple(builder, indices), context.get_constant(types.intp, 0)]
    first = get_item_pointer(context, builder, kind, make_array(kind)(context, builder, array), whole)
    return builder.bitcast(first, VECTOR.as_pointer())


@instruction
def load(typing: Any, array: Any, indices: Any) -> Any:
    """The last axis, of eight numbers, of a contiguous array at `indices` of all others, none negative."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return builder.load(_place(context, builder, sig.args[0], *values), align=8)

    return EIGHT(array, indices), generate


@instruction
def store(typing: Any, array: Any, indices: Any, lanes: Any) -> Any:
    """Put `lanes` where `load` takes them from."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        builder.store(values[2], _place(context, builder, sig.args[0], *values[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, indices, EIGHT), generate


@instruction
def where_above(typing: Any, left: Any, right: Any, value: Any, otherwise: Any) -> Any:
    """In each lane `value` where `left` is above `right`, else `otherwise`."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", values[0], values[1]), values[2], values[3])

    return EIGHT(EIGHT, EIGHT, EIGHT, EIGHT), generate


@instruction
def any_above(typing: Any, left: Any, right: Any) -> Any:
    """Whether `left` is above `right` in any lane."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        bits = builder.bitcast(builder.fcmp_ordered(">", *values), ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(EIGHT, EIGHT), generate
