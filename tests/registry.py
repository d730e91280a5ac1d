"""Every kind of light, attenuation, lobe and shading frequency, with numbers: laws run over these."""

import diffshade as ds

ATTENUATIONS = {
    "none": None,
    "quadratic": ds.QuadraticAttenuation(0.7, 0.11, 0.05),
    "quadratic, clamped": ds.QuadraticAttenuation(0.2, 0.01, 0.002),
    "linear": ds.LinearAttenuation(0.9, 0.3),
    "inverse square": ds.InverseSquare(),
    "exponential": ds.ExponentialAttenuation(0.21),
    "windowed": ds.Windowed(ds.InverseSquare(), reach=2.9),
}

LIGHTS = {
    **{
        f"point, {name}": ds.PointLight((0.7, 1.1, 2.3), (0.9, 0.7, 0.5), attenuation)
        for name, attenuation in ATTENUATIONS.items()
    },
    "point, one colour": ds.PointLight((0.7, 1.1, 2.3), 0.8),
    "parallel": ds.ParallelLight((0.6, 0.5, 1.9), (0.8, 0.9, 1.0)),
}

LOBES = {"phong": ds.Phong, "blinn_phong": ds.BlinnPhong}

SHININESS = {"n < 1": 0.6, "n = 1": 1.0, "n = 20": 20.0, "n = 400": 400.0}

FREQUENCIES = {
    "phong": ds.PhongShading(),
    "gouraud": ds.GouraudShading(),
    "flat": ds.FlatShading(),
}
