# SPDX-License-Identifier: Apache-2.0
"""Training: demonstrations and settings in, a model folder out. Torch lives here."""
