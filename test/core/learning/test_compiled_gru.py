# SPDX-License-Identifier: Apache-2.0
"""The compiled GRU is torch's: equal states, and equal gradients by its inputs and its parameters."""

import torch
from torch import nn

from mild_core.learning.training.compiled_gru import CompiledGRU, compile_memories


def states_and_slopes(layer: nn.Module, values: torch.Tensor) -> list[torch.Tensor]:
    layer.zero_grad()
    given = values.clone().requires_grad_()
    states = layer(given)[0]
    (states.square() * torch.arange(states.shape[1])[:, None]).sum().backward()
    assert given.grad is not None
    slopes = [parameter.grad.clone() for _, parameter in sorted(layer.named_parameters())]
    return [states.detach(), given.grad, *slopes]


def test_states_and_gradients_are_those_of_torch():
    with torch.random.fork_rng():
        torch.manual_seed(0)
        layer, values = nn.GRU(5, 7, batch_first=True), 3.0 * torch.randn(4, 11, 5)
    compiled = CompiledGRU(layer)
    found, expected = states_and_slopes(compiled, values), states_and_slopes(layer, values)
    assert len(found) == 6
    for one, other in zip(found, expected, strict=True):
        # Single precision, the terms of a sum in another order.
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-5 * float(other.abs().max()))


def test_every_memory_of_some_networks_is_replaced_and_shares_its_parameters():
    networks = nn.ModuleDict({"context": nn.Sequential(nn.Linear(2, 3), nn.GRU(3, 4, batch_first=True))})
    names, parameters = list(networks.state_dict()), {id(parameter) for parameter in networks.parameters()}
    compile_memories(networks)
    assert isinstance(networks["context"][1], CompiledGRU)
    assert list(networks.state_dict()) == names
    assert {id(parameter) for parameter in networks.parameters()} == parameters
