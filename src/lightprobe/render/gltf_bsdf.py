"""glTF's metallic-roughness reflectance as a BSDF for the path tracer Mitsuba 3, with its normal map.

Importing this module needs the extra `path` and makes `VARIANT` Mitsuba's variant. The model is that of
`render.brdf`, here as a function to be sampled, where the project's own renderer has integrals of it.

Notation: directions are in the shading frame, z along the interpolated normal or, after `_bent`, along the
mapped one; wi towards the camera, wo towards the light, h the half vector; alpha = roughness^2.
"""

import drjit as dr
import mitsuba as mi

VARIANT = "llvm_ad_rgb"
mi.set_variant(VARIANT)

_SEEN = 0.02  # least cosine between a mapped normal and the view, as in `surface.face_camera`
_CHANCE = 0.15, 0.95  # bounds of the chance of sampling the specular lobe


class GltfBsdf(mi.BSDF):
    """glTF 2.0 metallic-roughness, two-sided, single-scattering: (1-F) c_diff/pi + F D V, F = Schlick(F0).

    Properties: the textures `base_color` (linear) and `orm` (glTF's channels), and, if there is a normal map,
    the texture `normal` (unit vectors) with the mesh attributes `tangent` (3) and `handedness` (1).
    """

    def __init__(self, props: mi.Properties):
        mi.BSDF.__init__(self, props)
        self.base_color, self.orm = props["base_color"], props["orm"]
        names = ("normal", "tangent", "handedness")
        self.normal = [props[name] for name in names] if "normal" in props else None
        sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        kinds = (mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.GlossyReflection)
        self.m_components = [kind | sides | mi.BSDFFlags.SpatiallyVarying for kind in kinds]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def _bent(self, si, wi, active):
        """Return the frame of the mapped normal within that of the interpolated one, bent until wi sees it."""
        if self.normal is None:
            return mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
        mapped, tangent, hand = (texture.eval(si, active) for texture in self.normal)
        t = si.to_local(mi.Vector3f(tangent))
        t = dr.normalize(mi.Vector3f(t.x, t.y, 1e-9))
        b = mi.Vector3f(-t.y, t.x, 0) * dr.sign(hand.x)
        n = dr.normalize(t * mapped.x + b * mapped.y + mi.Vector3f(0, 0, 1) * mapped.z)
        return mi.Frame3f(dr.normalize(n + dr.maximum(_SEEN - dr.dot(n, wi), 0) * wi))

    def _surface(self, si, cosine, active):
        """Return diffuse colour, F0, alpha and the chance to sample the specular lobe; cosine: n.v."""
        base, orm = self.base_color.eval(si, active), self.orm.eval(si, active)
        roughness, metallic = orm.y, orm.z
        diffuse = base * (1 - metallic)
        f0 = 0.04 * (1 - metallic) + base * metallic
        fresnel = f0 + (1 - f0) * (1 - dr.abs(cosine)) ** 5
        chance = dr.mean(fresnel) / (dr.mean(fresnel) + dr.mean(diffuse) + 1e-4)
        return diffuse, f0, roughness * roughness, dr.clip(chance, *_CHANCE)

    def _terms(self, wi, wo, alpha):
        """Return h, D and V (height-correlated Smith) for directions on the upper side."""
        h = dr.normalize(wi + wo)
        a2 = alpha * alpha
        d = a2 / (dr.pi * dr.square(dr.square(h.z) * (a2 - 1) + 1))
        mask_o = wo.z * dr.sqrt(a2 + (1 - a2) * dr.square(wi.z))
        mask_i = wi.z * dr.sqrt(a2 + (1 - a2) * dr.square(wo.z))
        return h, d, 0.5 / dr.maximum(mask_o + mask_i, 1e-9)

    def _value_and_pdf(self, si, wo, active):
        flip = dr.sign(si.wi.z)
        wi, wo = mi.Vector3f(si.wi.x, si.wi.y, si.wi.z * flip), mi.Vector3f(wo.x, wo.y, wo.z * flip)
        active = active & (wi.z > 1e-6) & (wo.z > 1e-6)
        frame = self._bent(si, wi, active)
        wi, wo = frame.to_local(wi), frame.to_local(wo)
        active = active & (wi.z > 1e-6) & (wo.z > 1e-6)
        diffuse, f0, alpha, chance = self._surface(si, wi.z, active)
        h, d, v = self._terms(wi, wo, alpha)
        fresnel = f0 + (1 - f0) * (1 - dr.clip(dr.dot(wi, h), 0, 1)) ** 5
        value = ((1 - fresnel) * diffuse * dr.inv_pi + fresnel * d * v) * wo.z
        a2 = alpha * alpha
        visible = 2 * wi.z / (wi.z + dr.sqrt(a2 + (1 - a2) * dr.square(wi.z)))  # Smith G1 of the viewing side
        pdf = chance * visible * d / (4 * wi.z) + (1 - chance) * wo.z * dr.inv_pi
        return dr.select(active, value, 0), dr.select(active, pdf, 0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        """Sample visible normals or the cosine, chosen by the Fresnel share; weight = value / pdf."""
        flip = dr.sign(si.wi.z)
        wi = mi.Vector3f(si.wi.x, si.wi.y, si.wi.z * flip)
        frame = self._bent(si, wi, active)
        wi = frame.to_local(wi)
        _, _, alpha, chance = self._surface(si, wi.z, active)
        specular = sample1 < chance
        facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, dr.maximum(alpha, 1e-3), True)
        normal, _ = facets.sample(wi, sample2)
        mirrored, scattered = mi.reflect(wi, normal), mi.warp.square_to_cosine_hemisphere(sample2)
        wo = frame.to_world(dr.select(specular, mirrored, scattered))
        wo = mi.Vector3f(wo.x, wo.y, wo.z * flip)
        value, pdf = self._value_and_pdf(si, wo, active)
        sampled = dr.zeros(mi.BSDFSample3f)
        sampled.wo, sampled.pdf, sampled.eta = wo, pdf, 1.0
        sampled.sampled_component = dr.select(specular, mi.UInt32(1), mi.UInt32(0))
        kinds = mi.BSDFFlags.GlossyReflection, mi.BSDFFlags.DiffuseReflection
        sampled.sampled_type = dr.select(specular, *(mi.UInt32(+kind) for kind in kinds))
        return sampled, dr.select(active & (pdf > 0), value / pdf, 0)

    def eval(self, ctx, si, wo, active=True):
        """Value times cosine."""
        return self._value_and_pdf(si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        """Density of `sample` per solid angle."""
        return self._value_and_pdf(si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        """Both at once."""
        return self._value_and_pdf(si, wo, active)

    def to_string(self):
        """Name for Mitsuba's printouts."""
        return "GltfBsdf[]"


mi.register_bsdf("gltf_metallic_roughness", lambda props: GltfBsdf(props))
