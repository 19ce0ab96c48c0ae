"""Numerics that the other packages share: functions, roots, intervals of probabilities."""

from .brackets import EvaluatedMargin as EvaluatedMargin
from .brackets import find_brackets as find_brackets
from .brackets import find_brackets_traced as find_brackets_traced
from .clopper_pearson import bound_probabilities as bound_probabilities
from .elementary import angle as angle
from .elementary import arcsin as arcsin
from .elementary import arcsin_ratio as arcsin_ratio
from .elementary import arctan_ratio as arctan_ratio
from .elementary import artanh_ratio as artanh_ratio
from .elementary import minus_log as minus_log
from .elementary import one_minus_square as one_minus_square
from .elementary import pick_larger as pick_larger
from .elementary import pick_largest as pick_largest
from .elementary import pick_smaller as pick_smaller
from .elementary import quotient as quotient
from .elementary import quotient_or_infinite as quotient_or_infinite
from .elementary import share_of_one as share_of_one
from .elliptic import carlson_rf as carlson_rf
from .elliptic import jacobi as jacobi
from .implicit import Root as Root
from .implicit import differentiate_by_jacobian as differentiate_by_jacobian
from .implicit import differentiate_implicitly as differentiate_implicitly
from .reverse_mode import refuse_reverse_mode as refuse_reverse_mode
from .reverse_mode import transpose_by as transpose_by
from .roots import refine_brackets as refine_brackets
from .roots import select_tree as select_tree
