# SPDX-License-Identifier: Apache-2.0
"""Command a running pipeline by its services and read its parameters; start it with `-p enabled:=false`."""

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger


def call(node: Node, kind: type, name: str, **request: object) -> object:
    """Call a service and wait for its response."""
    client = node.create_client(kind, name)
    if not client.wait_for_service(timeout_sec=20.0):
        raise SystemExit(f"no service {name}: is the pipeline running?")
    future = client.call_async(kind.Request(**request))
    rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
    return future.result()


if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node("operator")
    given = call(node, GetParameters, "/pipeline/get_parameters", names=["model", "interaction"])
    print("model and interaction:", [value.string_value for value in given.values])
    print(call(node, Trigger, "/pipeline/reset").message)  # forget the person
    print(call(node, SetBool, "/pipeline/enable", data=True).message)  # follow from now on
    print(call(node, SetBool, "/pipeline/hold", data=True).message)  # stop smoothly at once
    print(call(node, SetBool, "/pipeline/hold", data=False).message)  # and go on
    rclpy.try_shutdown()
