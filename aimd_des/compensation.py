"""What agents do about signals that they lose: what `compensation=` takes."""

from aimd_des.dynamics.loss_compensation import Compensation, EstimatedLoss, KnownLoss, compensation_factor

__all__ = ["Compensation", "EstimatedLoss", "KnownLoss", "compensation_factor"]
