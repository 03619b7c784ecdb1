# How far the deadline that `Guard::judge` computes in f64 is from the one that Guard.v computes: gappa proofs/coq/guard.g
# Speeds are from 0.1 m/s on, ranges up to 10 km, at most 1000 frames; a time is seconds and nanoseconds, as a Duration is.
@rnd = float<ieee_64, ne>;

delay = rnd(delay_s + rnd(delay_n / 1000000000));
period = rnd(period_s + rnd(period_n / 1000000000));
lateness = rnd(lateness_s + rnd(lateness_n / 1000000000));
deadline rnd= ((range / speed - speed / (2 * brakes) - delay - frames * period) - lateness) - margin / speed;
nanoseconds rnd= deadline * 1000000000;

Exact = ((range / speed - speed / (2 * brakes) - (delay_s + delay_n / 1000000000)
  - frames * (period_s + period_n / 1000000000)) - (lateness_s + lateness_n / 1000000000)) - margin / speed;

{ range in [0, 10000] /\ speed in [0.1, 150] /\ brakes in [0.1, 20] /\ margin in [0, 100]
  /\ delay_s in [0, 5] /\ delay_n in [0, 999999999] /\ period_s in [0, 60] /\ period_n in [0, 999999999]
  /\ lateness_s in [0, 1] /\ lateness_n in [0, 999999999] /\ frames in [1, 1000]
  -> |nanoseconds - Exact * 1000000000| <= 0.25 }
