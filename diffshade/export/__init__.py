"""Materials for other tools, one foreign format a file, each with its error over angles.

They stand here, not with fits: a material is a fact, wherever it is from.

A format that lacks a term of ours has the nearest that it has: as bright where n = l = v, with
highlights as wide there. What is lost is measured by `angular_error`, on the formula that the other tool
computes from the very numbers in the file, and stands in the file.

Other renderers have albedos and radiometric units: in light of irradiance E across its rays a BSDF f has
the radiance E f n.l. Every export to one takes `irradiance`, the E that a light of I_p = 1 becomes there;
pi, unless told otherwise, so that k_d is the albedo rho: k_d = E rho / pi.
"""
