"""The parts of a law's C program that do not depend on the law: roots, phi regressors, search."""

SIGN = """\
static double NAME_sign(double x) { return (x > 0.0) - (x < 0.0); }
"""

PLAY = """\
static double NAME_play(double w, double u, double r) { return fmax(fmin(u + r, w), u - r); }
"""

HYSTERETIC = """\
/* s: last input, last output, direction, newest open extremum, then (input, output) of each extremum */
static double NAME_hysteretic(double *s, double u)
{
    double direction, distance;
    int top, i;
    if (u == s[0]) return s[1];
    direction = u > s[0] ? 1.0 : -1.0;
    top = (int)s[3];
    if (direction * s[2] < 0.0) {
        if (4 + 2 * (top + 1) < NAME_STATE) top += 1;
        else for (i = 4; i < 4 + 2 * top; i++) s[i] = s[i + 2];
        s[4 + 2 * top] = s[0];
        s[5 + 2 * top] = s[1];
    }
    while (top >= 1 && direction * (u - s[4 + 2 * (top - 1)]) >= 0.0) {
        if (top >= 2) top -= 2;
        else { s[4] = s[6]; s[5] = s[7]; top = 0; }
    }
    distance = u - s[4 + 2 * top];
    s[1] = fabs(atan(distance)) * distance + s[5 + 2 * top];
    s[0] = u; s[2] = direction; s[3] = top;
    return s[1];
}
"""

BOUC_WEN = """\
static double NAME_bw_slope(double h, double direction, const double *p)
{
    double size = p[3] == 1.0 ? fabs(h) : pow(fabs(h), p[3]);
    return p[0] - (p[1] * direction * NAME_sign(h) + p[2]) * size;
}

static int NAME_bw_too_long(double h, double step, const double *p)
{
    double rate = p[3] * (p[0] >= 0.0 && h * step >= 0.0 ? fabs(p[1] + p[2]) : p[1] + fabs(p[2]));
    if (p[3] > 1.0) rate *= pow(fabs(h) + fabs(p[0]) * fabs(step), p[3] - 1.0);
    return rate * fabs(step) > LONGEST_STEP;
}

static double NAME_bouc_wen(double h, double change, const double *p)
{
    double direction = NAME_sign(change), remaining = 1.0, share = 1.0;
    if (change == 0.0) return h;
    while (remaining > 0.0) {
        double step, k1 = NAME_bw_slope(h, direction, p), k2, k3, k4;
        if (p[0] > 0.0 && direction * h > 0.0 && fabs(k1) <= ROUNDING * p[0]) break;
        share = fmin(2.0 * share, remaining);
        while (share > SHORTEST_SHARE && NAME_bw_too_long(h, share * change, p)) share *= 0.5;
        step = share * change;
        k2 = NAME_bw_slope(h + 0.5 * step * k1, direction, p);
        k3 = NAME_bw_slope(h + 0.5 * step * k2, direction, p);
        k4 = NAME_bw_slope(h + step * k3, direction, p);
        h += step * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
        remaining -= share;
    }
    return h;
}
"""

BETTER = """\
/* whether a residual is less than the least one, or as small after a shorter move */
static int NAME_better(double size, double move, double least, double shortest)
{
    if (size < least * (1.0 - ALIKE)) return 1;
    return size <= least * (1.0 + ALIKE) && move < shortest * (1.0 - ALIKE);
}
"""

ROOTS = """\
static double NAME_poly(const double *c, int n, double x)
{
    double value = c[n];
    while (n-- > 0) value = value * x + c[n];
    return value;
}

static int NAME_zero(const double *c, int n, double x, double value)
{
    double size = fabs(c[n]);
    while (n-- > 0) size = size * fabs(x) + fabs(c[n]);
    return fabs(value) <= GRAZE * size;
}

static double NAME_newton(const double *c, const double *d, int n, double a, double b, double fa)
{
    double x = a, f = fa, slope, next;
    int i;
    for (i = 0; i < 200; i++) {
        slope = NAME_poly(d, n - 1, x);
        next = slope != 0.0 ? x - f / slope : INFINITY;
        if (!(a < next && next < b)) next = 0.5 * (a + b);
        if (fabs(next - x) <= TIGHT * fabs(next) || next == a || next == b) return next;
        x = next;
        f = NAME_poly(c, n, x);
        if (f == 0.0) return x;
        if ((f > 0.0) == (fa > 0.0)) a = x; else b = x;
    }
    return x;
}

static int NAME_quadratic(const double *c, double *roots)
{
    double discriminant, q, first, second;
    if (c[2] == 0.0) {
        if (c[1] == 0.0) return 0;
        roots[0] = -c[0] / c[1];
        return 1;
    }
    discriminant = c[1] * c[1] - 4.0 * c[2] * c[0];
    if (discriminant < 0.0) {
        if (discriminant < -GRAZE * c[1] * c[1]) return 0;
        discriminant = 0.0;
    }
    q = -0.5 * (c[1] + copysign(sqrt(discriminant), c[1]));
    first = q / c[2];
    second = q != 0.0 ? c[0] / q : first;
    roots[0] = fmin(first, second);
    roots[1] = fmax(first, second);
    return 2;
}

static double NAME_bound(const double *c, int n)
{
    double largest = 0.0;
    int i;
    while (n > 0 && c[n] == 0.0) n--;
    for (i = 0; i < n; i++)
        if (c[i] != 0.0) largest = fmax(largest, pow(fabs(c[i] / c[n]), 1.0 / (n - i)));
    return fmin(2.0 * largest * (1.0 + 1e-12), WIDEST);
}

/* cuts of [start, end] where the polynomial turns; chain holds its derivatives */
static int NAME_turns(const double *c, int n, double start, double end,
                      double chain[][NAME_DEGREE + 1], double *cuts)
{
    double found[NAME_DEGREE + 3], roots[2];
    int level, i, k, count = 1, n_roots = 0;
    for (i = 0; i <= n; i++) chain[0][i] = c[i];
    for (level = 1; level < n; level++)
        for (i = 0; i <= n - level; i++) chain[level][i] = (i + 1) * chain[level - 1][i + 1];
    cuts[0] = start;
    level = n > 3 ? n - 2 : 1;
    if (n == 2 && chain[1][1] != 0.0) { roots[0] = -chain[1][0] / chain[1][1]; n_roots = 1; }
    if (n > 2) n_roots = NAME_quadratic(chain[level], roots);
    for (i = 0; i < n_roots; i++)
        if (cuts[count - 1] < roots[i] && roots[i] < end) cuts[count++] = roots[i];
    cuts[count++] = end;
    while (level > 1) {
        int order = n - --level;
        double before = NAME_poly(chain[level], order, cuts[0]);
        found[0] = cuts[0];
        k = 1;
        for (i = 1; i < count; i++) {
            double after = NAME_poly(chain[level], order, cuts[i]);
            int touches = i < count - 1 && NAME_zero(chain[level], order, cuts[i], after);
            if (before * after < 0.0 && !touches)
                found[k++] = NAME_newton(chain[level], chain[level + 1], order, cuts[i - 1], cuts[i], before);
            if (touches) { found[k++] = cuts[i]; after = 0.0; }
            before = after;
        }
        found[k++] = cuts[count - 1];
        count = k;
        for (i = 0; i < count; i++) cuts[i] = found[i];
    }
    return count;
}

/* whether Horner's rule on the interval [start, end] keeps clear of zero */
static int NAME_clear(const double *c, int n, double start, double end)
{
    double low = c[n], high = c[n], size = fabs(c[n]);
    while (n-- > 0) {
        low = c[n] + fmin(low * start, low * end);
        high = c[n] + fmax(high * start, high * end);
        size = size * end + fabs(c[n]);
    }
    return low > GRAZE * size || high < -GRAZE * size;
}

/* smallest root in (start, end] if a few Newton steps find and prove it, else NAN */
static double NAME_near(const double *c, int n, double start, double end)
{
    double d[NAME_DEGREE + 1], x = start, before, slope;
    int i;
    for (i = 0; i < n; i++) d[i] = (i + 1) * c[i + 1];
    for (i = 0; i < FEW_ITERATIONS; i++) {
        before = x;
        slope = NAME_poly(d, n - 1, x);
        if (slope == 0.0) return NAN;
        x -= NAME_poly(c, n, x) / slope;
        if (!(start < x && x <= end)) return NAN;
        if (fabs(x - before) <= TIGHT * x) return NAME_clear(d, n - 1, start, x) ? x : NAN;
    }
    return NAN;
}

/* shortest move in (start, end] that is a root, NAN if none */
static double NAME_move(const double *c, int n, double start, double end)
{
    double chain[NAME_DEGREE + 1][NAME_DEGREE + 1], cuts[NAME_DEGREE + 3], roots[2], before, after, root;
    int i, count;
    if (n == 0 || !(start < end)) return NAN;
    if (n <= 2) {
        if (n == 1) { count = c[1] != 0.0; roots[0] = count ? -c[0] / c[1] : 0.0; }
        else count = NAME_quadratic(c, roots);
        for (i = 0; i < count; i++)
            if (start < roots[i] && roots[i] <= end) return roots[i];
        return NAN;
    }
    root = NAME_near(c, n, start, end);
    if (!isnan(root)) return root;
    if (isinf(end)) end = NAME_bound(c, n);
    if (!(start < end) || NAME_clear(c, n, start, end)) return NAN;
    count = NAME_turns(c, n, start, end, chain, cuts);
    before = NAME_poly(c, n, cuts[0]);
    for (i = 1; i < count; i++) {
        after = NAME_poly(c, n, cuts[i]);
        if (before * after < 0.0) return NAME_newton(c, chain[1], n, cuts[i - 1], cuts[i], before);
        if (NAME_zero(c, n, cuts[i], after)) return cuts[i];
        before = after;
    }
    return NAN;
}

/* move in [start, end] of the least residual, which is written to size; of those that tie the shortest */
static double NAME_best(const double *c, int n, double start, double end, double *size)
{
    double chain[NAME_DEGREE + 1][NAME_DEGREE + 1], cuts[NAME_DEGREE + 3], best = start, value;
    int i, count;
    if (isinf(end)) end = NAME_bound(c, n);
    *size = fabs(NAME_poly(c, n, start));
    if (n == 0 || !(start < end)) return best;
    count = NAME_turns(c, n, start, end, chain, cuts);
    for (i = 1; i < count; i++) {
        value = fabs(NAME_poly(c, n, cuts[i]));
        if (value < *size * (1.0 - ALIKE)) { best = cuts[i]; *size = value; }
    }
    return best;
}

static double NAME_nearest_root(const double *up, const double *down, double previous, int *found)
{
    const double *c[2];
    double start[2], end[2], m = previous, shortest = INFINITY, least = INFINITY, move, size;
    const double too_low = -up[0] * NAME_BRANCH;
    int n[2], turn, side, likely = too_low != 0.0 ? too_low < 0.0 : !(up[0] * up[1] <= 0.0);
    c[0] = up;
    c[1] = down;
    start[0] = fmax(NAME_LOW - previous, 0.0);
    end[0] = NAME_HIGH - previous;
    start[1] = fmax(previous - NAME_HIGH, 0.0);
    end[1] = previous - NAME_LOW;
    for (turn = 0; turn < 2; turn++) {
        side = turn ? 1 - likely : likely;
        for (n[side] = NAME_DEGREE; n[side] > 0 && c[side][n[side]] == 0.0; n[side]--) ;
        move = NAME_move(c[side], n[side], start[side],
                         fmin(end[side], shortest * (side ? 1.0 - ALIKE : 1.0 + ALIKE)));
        if (!isnan(move)) {
            shortest = move;
            m = side ? previous - move : previous + move;
        }
        if (too_low != 0.0 && shortest < INFINITY) break;
    }
    *found = shortest < INFINITY;
    if (*found || !NAME_NEAREST) return m;
    for (side = 0; side < 2; side++)
        if (start[side] <= end[side]) {
            move = NAME_best(c[side], n[side], start[side], end[side], &size);
            if (NAME_better(size, move, least, shortest)) {
                least = size;
                shortest = move;
                m = side ? previous - move : previous + move;
            }
        }
    return m;
}
"""

SEARCH = """\
static double NAME_bisect(NAME_state *s, double a, double b, double fa)
{
    double fb = NAME_residual(s, b), m, f;
    int i;
    for (i = 0; i < 200; i++) {
        m = i % 3 ? b - fb * (b - a) / (fb - fa) : 0.5 * (a + b);
        if (!(fmin(a, b) < m && m < fmax(a, b))) m = 0.5 * (a + b);
        if (m == a || m == b || fabs(b - a) <= 1e-15 * (fabs(a) + fabs(b))) return m;
        f = NAME_residual(s, m);
        if (f == 0.0) return m;
        if ((f > 0.0) == (fa > 0.0)) { a = m; fa = f; } else { b = m; fb = f; }
    }
    return b;
}

static int NAME_may_vanish(double f, double before)
{
    return (f > 0.0) != (before > 0.0) || f == 0.0 || !isnan(f) != !isnan(before);
}

/* zero between a and b; neither a pole nor the end of where functions have values is one */
static double NAME_zero_between(NAME_state *s, double a, double b, double fa, double fb, int *found)
{
    double m, size;
    if (isnan(fa)) { m = a; a = b; b = m; m = fa; fa = fb; fb = m; }
    m = NAME_bisect(s, a, b, fa);
    size = fabs(NAME_residual(s, m));
    *found = isnan(fb) ? size <= VANISHES * fabs(fa) : size <= fmax(fabs(fa), fabs(fb));
    return m;
}

static double NAME_solve(NAME_state *s, double previous, int *found)
{
    double inside = fmin(fmax(previous, NAME_LOW), NAME_HIGH), rest = NAME_residual(s, inside);
    double best = inside, least = isnan(rest) ? INFINITY : fabs(rest), m, f, zero;
    double step = FIRST_STEP * (NAME_HIGH - NAME_LOW);
    double below = inside, above = inside, f_below = rest, f_above = rest;
    *found = 1;
    if (rest == 0.0) return inside;
    while (below > NAME_LOW || above < NAME_HIGH) {
        if (above < NAME_HIGH) {
            m = fmin(inside + step, NAME_HIGH);
            f = NAME_residual(s, m);
            if (NAME_may_vanish(f, f_above)) {
                zero = NAME_zero_between(s, above, m, f_above, f, found);
                if (*found) return zero;
            }
            above = m; f_above = f;
            if (NAME_better(fabs(f), fabs(m - inside), least, fabs(best - inside))) {
                best = m;
                least = fabs(f);
            }
        }
        if (below > NAME_LOW) {
            m = fmax(inside - step, NAME_LOW);
            f = NAME_residual(s, m);
            if (NAME_may_vanish(f, f_below)) {
                zero = NAME_zero_between(s, below, m, f_below, f, found);
                if (*found) return zero;
            }
            below = m; f_below = f;
            if (NAME_better(fabs(f), fabs(m - inside), least, fabs(best - inside))) {
                best = m;
                least = fabs(f);
            }
        }
        step *= GROWTH;
    }
    *found = 0;
    return best;
}
"""
