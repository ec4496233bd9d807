# SPDX-License-Identifier: Apache-2.0
"""What goes out to a robot: its joints by name, and what each controller is sent."""
