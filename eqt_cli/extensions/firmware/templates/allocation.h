
{% set found = law.allocation %}
/* The ${found.what} from a torque: the least squares B+ torque,
   ${"within their limits" if found.limits else "without limits and bias"}. For a torque whose largest number is 1, rounding moves them by at
   most ${above(found.rounding)}; the bound of the torque moves them by at most ${above(found.carried)}. */
void ${label}_allocate(const ${real} torque[${m}], ${real} found[${found.inverse | length}]);
