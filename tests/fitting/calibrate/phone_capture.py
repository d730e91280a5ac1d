"""A phone's photographs of a sample ball and a mirror ball under one lamp, by POV-Ray.

The lamp stands somewhere else in each photograph, and is off in the last. Lengths are in centimetres,
and the phone is at the origin and looks along -z. A pixel is the mean of four rays. What is done to
POV-Ray's linear radiance is done in the order in which a phone does it: exposure, photon and read noise,
clipping, the sRGB curve (IEC 61966-2-1) to 8 bits, JPEG with half the resolution in colour.
"""

import imagecodecs
import numpy as np
import povray

SHAPE = (360, 540)
FOV = 0.3
RADIUS, MIRROR_RADIUS = 4.0, 3.0
CENTER, MIRROR_CENTER = np.array([-4.4, 0.3, -60.0]), np.array([4.9, -0.6, -58.0])
LAMPS = np.array([[18.0, 24, -30], [-30, 12, -25], [6, -28, -28], [-14, 26, -32], [26, -8, -22.0]])
LAMP_RADIUS = 4.0
AT = 40.0
"""Centimetres at which the lamp's intensity is 1."""

MATERIAL = {"ka": (0.09, 0.06, 0.05), "kd": (0.45, 0.3, 0.2), "ks": 0.25, "shininess": 30.0}
EXPOSURE = 1.37
"""What nobody knows of the phone."""
READ, GAIN = 1.5e-3, 4e-5
"""The read noise, and the variance per unit of radiance of the photons' noise, full scale 1."""
QUALITY = 92
SUBSAMPLING = "420"

CAMERA = {
    "kind": "perspective",
    "width": 2 * SHAPE[1],
    "height": 2 * SHAPE[0],
    "fov": FOV,
    "position": (0.0, 0.0, 0.0),
    "target": (0.0, 0.0, -1.0),
}
SAMPLE = {"kind": "sphere", "center": CENTER, "radius": RADIUS}
MIRROR = {"kind": "sphere", "center": MIRROR_CENTER, "radius": MIRROR_RADIUS}


def masks() -> tuple[np.ndarray, np.ndarray]:
    """The pixels of the sample ball and of the mirror ball, as drawn by hand."""
    camera = {**CAMERA, "height": SHAPE[0], "width": SHAPE[1]}
    return povray.mask([SAMPLE], camera), povray.mask([MIRROR], camera)


def _pixels(rays: np.ndarray) -> np.ndarray:
    """The means of two by two."""
    return rays.reshape(SHAPE[0], 2, SHAPE[1], 2, *rays.shape[2:]).mean(axis=(1, 3))


def radiance() -> list[np.ndarray]:
    """Linear images [H, W, 3], the last with the lamp off."""
    dark = {"ka": 0.0, "kd": 0.0, "ks": 0.0, "reflection": 0.9}
    objects = [(SAMPLE, MATERIAL), (MIRROR, dark)]
    found = []
    for lamp in LAMPS:
        bulb = {"kind": "sphere", "center": lamp, "radius": LAMP_RADIUS}
        light = {
            "kind": "point",
            "position": lamp,
            "intensity": AT**2,
            "attenuation": "inverse_square",
        }
        lit = [*objects, (bulb, {"ka": 1.0, "kd": 0.0, "ks": 0.0})]
        found.append(_pixels(povray.render(lit, [light], CAMERA, ambient=1.0)))
    return [*found, _pixels(povray.render(objects, [], CAMERA, ambient=1.0))]


def jpeg(linear: np.ndarray, rng: np.random.Generator) -> bytes:
    """The file that the phone writes of a radiance."""
    exposed = EXPOSURE * linear
    noisy = exposed + np.sqrt(READ**2 + GAIN * exposed) * rng.normal(size=exposed.shape)
    clipped = noisy.clip(0, 1)
    low = clipped <= 0.0031308
    encoded = np.where(low, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    codes = np.rint(255 * encoded).astype(np.uint8)
    data: bytes = imagecodecs.jpeg_encode(codes, level=QUALITY, subsampling=SUBSAMPLING)
    return data
