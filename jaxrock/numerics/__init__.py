"""Nothing about rocking: elementary functions, elliptic integrals, roots."""

from .elementary import angle as angle
from .elementary import arcsin as arcsin
from .elementary import arcsin_ratio as arcsin_ratio
from .elementary import arctan_ratio as arctan_ratio
from .elementary import artanh_ratio as artanh_ratio
from .elementary import decaying_share_of_one as decaying_share_of_one
from .elementary import minus_log as minus_log
from .elementary import one_minus_square as one_minus_square
from .elementary import quotient as quotient
from .elementary import quotient_or_infinite as quotient_or_infinite
from .elementary import share_of_one as share_of_one
from .elliptic import carlson_rf as carlson_rf
from .elliptic import jacobi as jacobi
from .falling_roots import ABOVE as ABOVE
from .falling_roots import BELOW as BELOW
from .falling_roots import NOWHERE as NOWHERE
from .falling_roots import Sample as Sample
from .falling_roots import Scan as Scan
from .falling_roots import chosen as chosen
from .implicit import Root as Root
from .implicit import through_jacobian as through_jacobian
from .implicit import through_residual as through_residual
from .roots import brackets as brackets
from .roots import brackets_traced as brackets_traced
from .roots import located as located
