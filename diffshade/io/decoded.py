"""What the reader of one file format hands over: samples as the file holds them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped

from diffshade.errors import BadInput
from diffshade.io.encoding import Encoding
from diffshade.io.exif import Shot

__all__ = ["Decoded", "Mask", "Pixels", "Plane", "Samples", "with_channels"]

Samples = Shaped[np.ndarray, "H W C"]
Pixels = Float[np.ndarray, "H W C"]
Plane = Float[np.ndarray, "H W"]
Mask = Bool[np.ndarray, "H W"]


@dataclass(frozen=True, eq=False)
class Decoded:
    """Samples in the file's own numbers, colour before alpha."""

    samples: Samples
    """C = 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha."""
    full_code: int | None
    """The code that stands for full scale; None for floating point."""
    bits: int
    """Bits a sample."""
    encoding: Encoding
    """What the file says about its values."""
    shot: Shot | None = None
    """What it was taken with, where the file says so."""

    def scaled(self) -> tuple[Pixels, Plane | None]:
        """Colour and alpha with full scale 1; alpha is None where it is absent or opaque."""
        values = self._scaled_samples()
        channels = values.shape[-1]
        if channels in (1, 3):
            return values, None
        alpha = values[..., -1]
        return values[..., :-1], None if np.all(alpha == 1) else alpha

    def _scaled_samples(self) -> Pixels:
        """float32, which holds 24 bits; float64 for 32-bit integers and float64."""
        wide = self.samples.dtype.itemsize > 4 or (
            self.full_code is not None and self.full_code.bit_length() > 24
        )
        values = self.samples.astype(np.float64 if wide else np.float32)
        return values if self.full_code is None else np.true_divide(values, self.full_code)


def with_channels(array: np.ndarray) -> Samples:
    """[H, W] as [H, W, 1]; refuses what is not grey or RGB, with or without alpha."""
    samples = array[..., None] if array.ndim == 2 else array
    if samples.ndim != 3 or not 1 <= samples.shape[-1] <= 4:
        raise BadInput(f"holds an array of shape {array.shape}; save it as one grey or RGB image")
    return samples
