"""Trials of the first pass: changes of the object that no small step leads to, kept where photos ask for them.

Photos under unknown lights leave some things open to gradient descent: light and base colour share a factor
(the light/albedo scale), paint under one light looks like metal under another, and a closed vessel never
opens by moving its surface a little. So a few whole changes are tried out.

What is tried when, in this order (`trials.schedule`):

    first two checkpoints   the base colours times 1.4, 1 or 1/1.4, lights solved anew; the least image error
                            decides (`brightness.choose_brightness`), at the second after the first trial
    first trial: at the     1. a part of the surface that may well be a lid over a cavity is looked for
    second checkpoint          (`cavities`): where there is one, the surface does not follow its texture yet;
                            2. a new material is fitted from each of four brightnesses, as a wrong one
                               misleads the shape (`brightness.best_new`)
    second trial: after     1. lids are opened (`cavities`, `lids`);
    .7 of the pass          2. each of the object's few materials becomes metal, or no metal (`metals`);
                            3. the material is made up to four times brighter or darker
                               (`brightness.best_rescaled`)

How: the changed material is a copy, fitted for a short time on the surface as it is, without silhouettes
(`trial.Trial`), which costs a fraction of as many steps of the pass. A light bends to the pixels that it is
solved from, and a material fitted to the same pixels turns into a mirror; so each step solves the light from
one half of a photo's pixels, drawn at random, and fits the material to the other.

How a change is judged: by photos, each of which has one vote, so that the spread over the photos tells how
sure a mean is (`evidence.Bar`: the mean gain must be larger than a bound and than some standard errors). Two
things are measured on each photo: the error of the pixels that the change is about, and the disagreement of
halves of the object about the photo's light (`disagreement`), since a light that is free to bend explains a
wrong surface only too well.

- A cavity or a metal concerns a part of the object. It is kept where the part's own pixels are explained
  better by more than the bar, and halves of the object disagree no more than before, within one standard
  error.
- A brightness concerns all pixels alike, and where all reflections take the surface's colour halves agree at
  any brightness. So several kinds of evidence are added, as negative logarithms of probability ("nll"): how
  much more halves disagree than under the brightness with the least disagreement, how plausible the lights
  are, in the second trial how bright the metals (`plausibility`), and how usual the base colour is. The least sum
  wins. A material that is nearly
  finished is left only for one that is better by more than the bar, too, or has far more plausible lights.
"""
