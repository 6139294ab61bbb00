
$tables
static $motion
void ${label}_reference($real t, ${label}_input *input)
{
$piece
    input->t = t;
    ${label}_motion(&input->t, $held, $told);
}
