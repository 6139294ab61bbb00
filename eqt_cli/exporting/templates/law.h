/* Exported by eqt $version: $title on $group.

   $about

   Experiment $experiment, configuration $digest.

   Arrays are row by row, coordinates in the order $axes, and velocities,
   accelerations and torques are those of the body frame. At t = k period, call ${label}_torque with
   what is known at that time, and hold its torque until the next call. There is no other state than
   that of the structures below: two vehicles need two of them.

   Rounding, in $real: at $states states of $runs runs of this experiment, and at $random random
   ones of their size with any error of the pose, some of them half turns, the torque differs from
   that of exact numbers by at most
$bounds
   $apart

   $operations operations. ${label}_check.c checks all of this, and the file README.md has more. */
#ifndef $guard
#define $guard

#ifdef __cplusplus
extern "C" {
#endif

/* What the law is told. */
typedef struct {
$input
} ${label}_input;

/* Its numbers. */
typedef struct {
$numbers
} ${label}_numbers;

/* $memory_about */
typedef struct {
$memory
} ${label}_memory;

/* The numbers of the experiment. */
extern const ${label}_numbers ${label}_defaults;

/* Sets the memory to that of the start: once, before the first torque. */
void ${label}_start(const ${label}_numbers *numbers, ${label}_memory *memory, const ${label}_input *input);

/* The torque, in $torque_unit; then the memory goes on by one period. */
void ${label}_torque(const ${label}_numbers *numbers, ${label}_memory *memory, const ${label}_input *input,
        $real torque[$m]);
$reference
#ifdef __cplusplus
}
#endif

#endif
