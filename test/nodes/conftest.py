"""Fixtures: a private DDS domain, a probe in it, and nodes that end with the test."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mebo_grasp.nodes.domain import private_domain

from .harness import NodeUnderTest, Probe

Launch = Callable[..., NodeUnderTest]


@pytest.fixture
def domain_id() -> Iterator[int]:
    """A DDS domain that nobody else on this machine uses."""
    with private_domain() as domain_id:
        yield domain_id


@pytest.fixture
def probe(domain_id: int) -> Iterator[Probe]:
    """The test's own node."""
    probe = Probe(domain_id)
    yield probe
    probe.close()


@pytest.fixture
def launch(domain_id: int, tmp_path: Path) -> Iterator[Launch]:
    """Start a node with parameters: ``launch("hand_node", object="mug")``; all end with the test."""
    nodes: list[NodeUnderTest] = []

    def start(executable: str, **parameters: Any) -> NodeUnderTest:
        node = NodeUnderTest(executable, parameters, tmp_path, domain_id)
        nodes.append(node)
        return node

    yield start
    for node in nodes:
        if node.alive:
            node.process.send_signal(signal.SIGINT)
    for node in nodes:
        node.stop()
        if "Traceback" in node.log:
            pytest.fail(f"a node printed a traceback:\n{node.log}")
