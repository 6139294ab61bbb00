
{% set found = law.allocation %}
/* The ${found.what} from a torque: ${"by priority," if found.program else "the least squares B+ torque,"}
   ${"without limits and bias" if not found.limits and not found.program else "within their limits"}. ${"At the states of the check" if found.program else "For a torque whose largest number is 1"}, rounding moves them by at
   most ${above(found.rounding)}; the bound of the torque moves them by at most ${above(found.carried)}. */
void ${label}_allocate(const ${real} torque[${m}], ${real} found[${found.inverse | length}]);
